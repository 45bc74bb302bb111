"""NumPy, pose by pose: 4x4 matrices, and slopes by finite differences. The first thing that one writes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.bench.peers.elements import Elements

Array = NDArray[np.float64]

_STEP = 1e-6  # of a parameter, mm or rad: halves of the digits of a metre in double precision are left


def position(arm: Elements, q: Array, x: Array) -> Array:
    """Of the point in world, shape (3,), mm, at one posture q, shape (dof,), with errors x, shape (n,)."""
    pose = arm.base
    for each in arm.motions:
        value = each.value
        if each.joint is not None:
            value += each.rate * q[each.joint]
        if each.parameter is not None:
            value += x[each.parameter]
        pose = pose @ _matrix(each.turn, each.axis, value)
    return (pose @ arm.tool)[:3, 3]


def position_and_slopes(arm: Elements, q: Array, x: Array) -> tuple[Array, Array]:
    """Positions, shape (N, 3), and forward differences by every parameter, (N, 3, n), of postures q, shape (N, dof)."""
    p, slopes = np.empty((len(q), 3)), np.empty((len(q), 3, arm.count))
    for k in range(len(q)):
        p[k] = position(arm, q[k], x)
        for i in range(arm.count):
            moved = x.copy()
            moved[i] += _STEP
            slopes[k, :, i] = (position(arm, q[k], moved) - p[k]) / _STEP
    return p, slopes


def _matrix(turn: bool, axis: int, value: float) -> Array:
    matrix = np.eye(4)
    if not turn:
        matrix[axis, 3] = value
        return matrix
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i] = matrix[j, j] = np.cos(value)
    matrix[j, i] = np.sin(value)
    matrix[i, j] = -matrix[j, i]
    return matrix
