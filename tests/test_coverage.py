"""Intervals of every parameter and of predicted positions hold the truth as often as they say. Short form of
interval_coverage.py."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from interval_coverage import LEVELS, Coverage, cover

TRIALS = {"position": 120, "pose": 120, "pixels": 50}


@cache
def covered(kind: str) -> Coverage:
    return cover(kind, TRIALS[kind])


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("kind", TRIALS)
def test_intervals_hold_the_truth_as_often_as_they_say(kind: str, level: float) -> None:
    """Each parameter and each of 60 coordinates by itself, all together with 99 %; and in the mean."""
    found = covered(kind)
    share = found.share(level)
    outside = {found.names[i]: share[i] for i in np.flatnonzero(np.abs(share - level) > found.band(level))}
    assert outside == {}
    assert share.mean() == pytest.approx(level, abs=0.03)
