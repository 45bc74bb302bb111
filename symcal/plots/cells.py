"""A figure over a plane as cells, seen from above and from the side."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from matplotlib.collections import QuadMesh
from matplotlib.colors import Normalize
from numpy.typing import NDArray

Array = NDArray[np.float64]


def from_side(points: Array, origin: Array) -> Array:
    """Distance from the z axis through a point, and height, shape (k, 2), of points (k, 3)."""
    return np.column_stack([np.hypot(points[:, 0] - origin[0], points[:, 1] - origin[1]), points[:, 2]])


def in_cells(
    flat: Array,
    values: Array,
    cell: float,
    statistic: Literal["max", "mean"] = "max",
    where: NDArray[np.bool_] | None = None,
) -> tuple[Array, Array, Array]:
    """The largest value (or the mean) of all points (k, 2) in a cell, NaN where there are none, and edges of the cells.

    Args:
        cell: length of a side. where: points that count, shape (k,), all if None; the cells are the same.
    """
    low, high = flat.min(axis=0), flat.max(axis=0)
    edges = [a + cell * np.arange(int(np.ceil(max(b - a, cell) / cell)) + 1) for a, b in zip(low, high, strict=True)]
    own = slice(None) if where is None else where
    if not len(values[own]):
        return np.full((len(edges[0]) - 1, len(edges[1]) - 1), np.nan), edges[0], edges[1]
    shape = len(edges[0]) - 1, len(edges[1]) - 1
    at = [np.digitize(flat[own, i], edges[i]) - 1 for i in range(2)]
    place = np.ravel_multi_index([np.clip(a, 0, n - 1) for a, n in zip(at, shape, strict=True)], shape)
    count = np.bincount(place, minlength=shape[0] * shape[1])
    if statistic == "mean":
        found = np.bincount(place, values[own], len(count)) / np.maximum(count, 1)
    else:
        found = np.full(len(count), -np.inf)
        np.maximum.at(found, place, values[own])
    return np.where(count, found, np.nan).reshape(shape), edges[0], edges[1]


def draw_cells(axes: Any, cells: tuple[Array, Array, Array], scale: Normalize) -> QuadMesh:
    """Cells as `in_cells` gives them, in grey-proof colours and true proportions."""
    found, x, y = cells
    mesh: QuadMesh = axes.pcolormesh(x, y, found.T, norm=scale, cmap="cividis", rasterized=True)
    axes.set_aspect("equal")
    axes.locator_params(nbins=6)
    return mesh
