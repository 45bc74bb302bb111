r"""Robust losses of a reading's residual: weights and slopes by t = |r| / sigma, the norm over its d components.

    huber    w = 1 where t <= k, else k / t          convex; bears many small slips, is drawn along by gross ones
    cauchy   w = 1 / (1 + (t / k)^2)                 redescending: the further off, the less it counts
    tukey    w = (1 - (t / c)^2)^2 within c, else 0  redescending: what is far off does not count at all

The estimating function is psi(r) = w(t) r; averaged over directions its derivative is w + t w' / d. k is the 95 %
quantile of the norm of d unit normals (ours), c makes the location of d-dimensional normal readings 95 % efficient
(4.685 for d = 1, [Maronna2019] sec. 2.3).

A loss that redescends has many minima, and one whose scale may fall with its weights ends where the model passes
through half of the readings: both start from where the convex one ended, with its scale held ([Yohai1987]). The scale
is then taken once from the readings that count (`weighted_sigmas`), and held again.
"""

from __future__ import annotations

from functools import cache
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]
Loss = Literal["linear", "huber", "cauchy", "tukey"]

LOSSES: tuple[Loss, ...] = ("linear", "huber", "cauchy", "tukey")
REDESCENDING: tuple[Loss, ...] = ("cauchy", "tukey")
_QUANTILE = 0.95  # of the norm of unit normals: where a residual starts to count less
_EFFICIENCY = 0.95  # of tukey's location at the normal law
_WIDEST = 40.0  # standard deviations, within which c is sought
_NODES = 20000  # of the mean over a normal law: c to 1e-5 of itself


def loss_weights(loss: Loss, t: Array, block: int) -> Array:
    """w of norms in units of sigma, same shape. Args: block: d, components of a reading."""
    if loss == "linear":
        return np.ones_like(t)
    u = (t / tuning(loss, block)) ** 2
    if loss == "huber":
        return np.asarray(1 / np.sqrt(np.maximum(u, 1.0)))
    if loss == "cauchy":
        return np.asarray(1 / (1 + u))
    return np.asarray(np.maximum(1 - u, 0.0) ** 2)


def loss_slopes(loss: Loss, t: Array, block: int) -> Array:
    """w + t w' / d: the derivative of psi averaged over directions, same shape."""
    if loss == "linear":
        return np.ones_like(t)
    u = (t / tuning(loss, block)) ** 2
    if loss == "huber":
        return np.asarray(np.where(u <= 1, 1.0, (1 - 1 / block) / np.sqrt(np.maximum(u, 1.0))))
    if loss == "cauchy":
        return np.asarray(1 / (1 + u) - 2 / block * u / (1 + u) ** 2)
    inner = np.maximum(1 - u, 0.0)
    return np.asarray(inner**2 - 4 / block * u * inner)


@cache
def tuning(loss: Loss, block: int) -> float:
    """k or c, in units of sigma."""
    if loss != "tukey":
        return float(np.sqrt(2 * scipy.special.gammaincinv(block / 2, _QUANTILE)))
    t = _normal_norms(block)

    def too_low(c: float) -> float:
        u = np.minimum((t / c) ** 2, 1.0)
        slope = np.mean((1 - u) ** 2 - 4 / block * u * (1 - u))
        return float(slope**2 / (np.mean(t**2 * (1 - u) ** 4) / block)) - _EFFICIENCY

    return float(scipy.optimize.brentq(too_low, 1.0 + np.sqrt(block), _WIDEST))


@cache
def shrinkage(loss: Loss, block: int) -> float:
    """E[w t^2] / (d E[w]) for unit normals: by how much the weighted mean square is below the variance."""
    t = _normal_norms(block)
    w = loss_weights(loss, t, block)
    return float(np.mean(w * t**2) / (block * np.mean(w)))


def normal_median(block: int) -> float:
    """Median of the norm of d unit normals."""
    return float(np.sqrt(2 * scipy.special.gammaincinv(block / 2, 0.5)))


def _normal_norms(block: int) -> Array:
    """Norms of d unit normals in the middles of so many intervals of equal probability."""
    return np.asarray(np.sqrt(2 * scipy.special.gammaincinv(block / 2, (np.arange(_NODES) + 0.5) / _NODES)))
