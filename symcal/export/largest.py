"""The largest difference of two poses over a box: searched, so a lower bound of the true one.

Random postures and corners of the box first; from the worst of them the difference is climbed with its exact gradient.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.kernels.batch import batch_function
from symcal.kinematics import function

SX = ca.SX
Array = NDArray[np.float64]

POSTURES = 4096
"""Random ones at which every search looks first."""
_CORNERS = 1024
_CLIMBS = 8
_TINY = 1e-18  # mm^2: there is nothing to climb


@dataclass(frozen=True, slots=True)
class Largest:
    """The largest distance of two origins, mm, and the largest angle between two frames, rad; where each was found,
    shape (k,)."""

    mm: float
    rad: float
    at_mm: Array
    at_rad: Array


def largest_difference(first: SX, second: SX, v: SX, lower: Array, upper: Array) -> Largest:
    """Search for the largest differences of two poses, shape (4, 4), over lower <= v <= upper, shape (k,)."""
    distance2 = ca.sumsqr(first[:3, 3] - second[:3, 3])
    turn2 = ca.sumsqr(first[:3, :3] - second[:3, :3])  # 8 sin(angle / 2)^2: smooth where the angle is not
    starts = _starts(lower, upper)
    both = batch_function(function("both", {"v": v}, {"d": ca.vertcat(distance2, turn2)}), evaluations=len(starts))
    found = both(starts)[0].reshape(len(starts), 2)
    (mm2, at_mm), (size2, at_rad) = (
        _climbed(expression, v, (lower, upper), starts, values)
        for expression, values in zip((distance2, turn2), found.T, strict=True)
    )
    return Largest(float(np.sqrt(mm2)), float(2 * np.arcsin(min(np.sqrt(size2 / 8), 1.0))), at_mm, at_rad)


def _starts(lower: Array, upper: Array) -> Array:
    """Random points and corners of the box, shape (n, k)."""
    rng, k = np.random.default_rng(0), len(lower)
    if 2**k <= _CORNERS:
        corners = np.array(list(product((0.0, 1.0), repeat=k)))
    else:
        corners = rng.integers(0, 2, (_CORNERS, k)).astype(float)
    share = np.vstack([np.full(k, 0.5), corners, rng.random((POSTURES, k))])
    return np.asarray(lower + share * (upper - lower))


def _climbed(size: SX, v: SX, box: tuple[Array, Array], starts: Array, values: Array) -> tuple[float, Array]:
    """The largest value found, and where."""
    order = np.argsort(-values)[:_CLIMBS]
    best, at = float(values[order[0]]), starts[order[0]]
    if best < _TINY:
        return best, at
    lower, span = box[0], np.where(box[1] > box[0], box[1] - box[0], 1.0)
    climb, unit = function("climb", {"v": v}, {"f": size, "g": ca.gradient(size, v)}), best

    def down(share: Array) -> tuple[float, Array]:
        f, g = climb(lower + share * span)
        return -float(f) / unit, -np.asarray(g).ravel() * span / unit

    bounds = [(0.0, float(b > a)) for a, b in zip(*box, strict=True)]
    for start in starts[order]:
        found = scipy.optimize.minimize(down, (start - lower) / span, jac=True, method="L-BFGS-B", bounds=bounds)
        if -found.fun * unit > best:
            best, at = float(-found.fun * unit), lower + np.clip(found.x, 0.0, 1.0) * span
    return best, at
