"""A figure over a plane as cells, seen from above and from the side."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binned_statistic_2d

Array = NDArray[np.float64]


def from_side(points: Array, origin: Array) -> Array:
    """Distance from the z axis through a point, and height, shape (k, 2), of points (k, 3)."""
    return np.column_stack([np.hypot(points[:, 0] - origin[0], points[:, 1] - origin[1]), points[:, 2]])


def in_cells(
    flat: Array, values: Array, cell: float, statistic: Literal["max", "mean"] = "max"
) -> tuple[Array, Array, Array]:
    """The largest value (or the mean) of all points (k, 2) in a cell, NaN where there are none, and edges of the cells.

    Args:
        cell: length of a side.
    """
    low, high = flat.min(axis=0), flat.max(axis=0)
    edges = [a + cell * np.arange(int(np.ceil(max(b - a, cell) / cell)) + 1) for a, b in zip(low, high, strict=True)]
    found = binned_statistic_2d(flat[:, 0], flat[:, 1], values, statistic=statistic, bins=edges)
    return np.asarray(found.statistic), edges[0], edges[1]
