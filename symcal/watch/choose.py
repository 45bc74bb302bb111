r"""Poses for a check: those that find small offsets of all joints alike.

With rows [J L, D] of all poses over their noise, M = sum of their squares, and d for D, a for the rest,

    lambda_i = M_ii - M_ia (1 + M_aa)^-1 M_ai

is what offset i of a plausible size, squared over its variance, has beside what the calibration leaves unknown: the
Schur complement of M with the prior of J L in it, concave in M. What is made large is the power mean of the lambda_i
with power -4, in which the smallest counts most. Ours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.planning.criteria import Criterion
from symcal.planning.exchange import exchange, pool_of

Array = NDArray[np.float64]

_POWER = 4.0
_APART = 0.05  # of the working area, between two poses


def offsets_criterion(joints: int) -> Criterion:
    """The criterion over information matrices whose last columns are offsets of so many joints."""

    def parts(m: Array) -> tuple[Array, Array]:
        """lambda_i, shape (..., k), and slopes g_i with d lambda_i = g_i^T dM g_i, shape (..., n, k)."""
        n = m.shape[-1] - joints
        rest = np.linalg.solve(m[..., :n, :n] + np.eye(n), m[..., :n, n:])
        own = np.einsum("...ii->...i", m[..., n:, n:]) - np.sum(m[..., :n, n:] * rest, axis=-2)
        unit = np.broadcast_to(np.eye(joints), (*rest.shape[:-2], joints, joints))
        return np.maximum(own, 0.0), np.concatenate([-rest, unit], axis=-2)

    def score(m: Array) -> Array:
        own = parts(m)[0]
        least = np.maximum(own.min(axis=-1, keepdims=True), 1e-300)
        mean = np.sum((least / np.maximum(own, 1e-300)) ** _POWER, axis=-1)
        return np.asarray(np.log(least[..., 0]) - np.log(mean) / _POWER)

    def slope(m: Array) -> Array:
        own, steep = parts(m)
        own = np.maximum(own, 1e-300)
        share = (own.min() / own) ** _POWER
        weight = share / own / share.sum()
        return np.asarray((steep * weight) @ steep.T)

    return Criterion("offsets", "1", True, lambda m: np.exp(score(m)), score, slope, concave=True, smooth=True)


def choose(poses: Array, unit: Array, rows: Array, count: int, joints: int) -> NDArray[np.intp]:
    """Which of a pool of poses to measure, shape (count,).

    Args:
        poses: (K, dof). unit: the same in units of the working area. rows: see `symcal.watch.sensitivity.plan_rows`.
    Raises:
        RefusedError: the pool has not so many poses that are apart.
    """
    pool = pool_of(poses, rows, unit)
    size = rows.shape[2]
    return exchange(pool, offsets_criterion(joints), count, np.zeros((size, size)), distance=_APART)
