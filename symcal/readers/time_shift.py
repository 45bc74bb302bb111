"""A constant shift between the clocks of two recordings, from the speeds in both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LONGEST = 5.0
"""s: larger shifts are not looked for."""
_MOST = 40_000  # times of the grid
_STEPS = 500  # to the longest shift
_CONVINCING = 0.5  # correlation of speeds
_LEAST = 50  # times in common
_ALIKE = 0.03  # of the correlation: moves that take equally long go together at several shifts, and the least is meant


@dataclass(frozen=True, slots=True)
class Shift:
    """By how many s the second recording is late, and the correlation of speeds with and without it."""

    seconds: float
    correlation: float
    without: float


def found_shift(t: Array, speed: Array, other_t: Array, other: Array, longest: float = LONGEST) -> Shift | None:
    """The shift at which two speeds go together best; None where they hardly do at any.

    Speeds are taken on a common grid as fine as the slower recording, and correlated at every shift of whole steps; a
    parabola through the best and its neighbours gives a part of a step.

    Args:
        t, other_t: times, ascending, shape (N,) and (M,), s. speed, other: of any size, shape (N,) and (M,).
    """
    if min(len(t), len(other_t)) < _LEAST:
        return None
    step = max(float(np.median(np.diff(t))), float(np.median(np.diff(other_t))), longest / _STEPS)
    begin, end = max(t[0], other_t[0]) - longest, min(t[-1], other_t[-1]) + longest
    step = max(step, (end - begin) / _MOST)
    grid = np.arange(max(begin, t[0]), min(end, t[-1]), step)
    steps = int(longest / step)
    if len(grid) < _LEAST or not steps:
        return None
    one = np.interp(grid, t, speed)
    shifts = np.arange(-steps, steps + 1) * step
    found = np.array([_correlation(one, grid + shift, other_t, other) for shift in shifts])
    if not np.isfinite(found).any():
        return None
    tops = np.flatnonzero(_tops(found) & (found >= np.nanmax(found) - _ALIKE))
    best = int(tops[np.argmin(np.abs(shifts[tops]))])
    seconds = float(shifts[best])
    if 0 < best < len(found) - 1 and np.isfinite(found[best - 1 : best + 2]).all():
        left, top, right = found[best - 1 : best + 2]
        bend = left - 2 * top + right
        seconds += step * float(0.5 * (left - right) / bend) if bend < 0 else 0.0
    if found[best] < _CONVINCING:
        return None
    return Shift(seconds, float(found[best]), float(found[steps]))


def _tops(found: Array) -> NDArray[np.bool_]:
    """What is no less than its neighbours."""
    around = np.concatenate([[-np.inf], np.nan_to_num(found, nan=-np.inf), [-np.inf]])
    return np.isfinite(found) & (around[1:-1] >= around[:-2]) & (around[1:-1] >= around[2:])


def _correlation(one: Array, times: Array, t: Array, speed: Array) -> float:
    common = (times >= t[0]) & (times <= t[-1])
    if common.sum() < max(_LEAST, len(times) // 4):
        return np.nan
    a, b = one[common], np.interp(times[common], t, speed)
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0 else np.nan
