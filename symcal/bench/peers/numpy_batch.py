"""NumPy, all poses at once: stacks of 4x4 matrices, and the geometric Jacobian."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.bench.peers.elements import Element, Elements

Array = NDArray[np.float64]


def positions(arm: Elements, q: Array, x: Array) -> Array:
    """Of the point in world, shape (N, 3), mm, at postures q, shape (N, dof), with errors x, shape (n,)."""
    pose = np.broadcast_to(arm.base, (len(q), 4, 4))
    for each in arm.motions:
        pose = pose @ _matrices(each, _values(each, q, x))
    return (pose @ arm.tool)[:, :3, 3]


def positions_and_slopes(arm: Elements, q: Array, x: Array) -> tuple[Array, Array]:
    """The same with exact slopes, shape (N, 3, n): axis x lever of a turn, axis of a shift."""
    pose = np.broadcast_to(arm.base, (len(q), 4, 4))
    axes: list[tuple[Element, Array, Array]] = []
    for each in arm.motions:
        if each.parameter is not None:
            axes.append((each, pose[:, :3, each.axis], pose[:, :3, 3]))
        pose = pose @ _matrices(each, _values(each, q, x))
    p = (pose @ arm.tool)[:, :3, 3]
    slopes = np.zeros((len(q), 3, arm.count))
    for each, axis, origin in axes:
        slopes[:, :, each.parameter] = np.cross(axis, p - origin) if each.turn else axis
    return p, slopes


def _values(each: Element, q: Array, x: Array) -> Array:
    value = each.value + (0.0 if each.parameter is None else x[each.parameter])
    return np.full(len(q), value) if each.joint is None else value + each.rate * q[:, each.joint]


def _matrices(each: Element, values: Array) -> Array:
    matrices = np.zeros((len(values), 4, 4))
    matrices[:, range(4), range(4)] = 1.0
    if not each.turn:
        matrices[:, each.axis, 3] = values
        return matrices
    i, j = (each.axis + 1) % 3, (each.axis + 2) % 3
    matrices[:, i, i] = matrices[:, j, j] = np.cos(values)
    matrices[:, j, i] = np.sin(values)
    matrices[:, i, j] = -matrices[:, j, i]
    return matrices
