"""Where a robot stands still, from its joint readings alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_GAP = 10.0  # times the usual time between readings: what is longer is a hole, across which nothing is known


def still_intervals(t: Array, q: Array, band: Array, least: float) -> list[tuple[int, int]]:
    """First and behind the last reading of every interval in which no joint leaves its band.

    Each is as long as it can be from its first reading on, lasts at least ``least``, and has no hole.

    Args:
        t: times, ascending, shape (N,), s. q: readings, shape (N, dof). band: of every joint, its largest less its
            smallest reading, shape (dof,).
    """
    gap = _GAP * float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    found = []
    first, low, high = 0, q[0], q[0]
    for now in range(1, len(t) + 1):
        hole = now == len(t) or t[now] - t[now - 1] > gap
        if not hole:
            lower, higher = np.minimum(low, q[now]), np.maximum(high, q[now])
            if np.all(higher - lower <= band):
                low, high = lower, higher
                continue
        if t[now - 1] - t[first] >= least:
            found.append((first, now))
            first = now
        elif hole:
            first = now
        else:  # nothing that begins before the last reading out of the band of this one can go on
            out = np.flatnonzero(np.any(np.abs(q[first:now] - q[now]) > band, axis=1))
            first += int(out[-1]) + 1 if len(out) else 1
        if now < len(t):
            low, high = q[first : now + 1].min(axis=0), q[first : now + 1].max(axis=0)
    return found
