"""Ways to divide poses into two halves, by everything but what was measured there.

A law that holds for any halves that the readings of the instruments had no part in choosing holds for all of these, but
they do not reveal the same. What a model lacks acts on poses that are drawn alike for both halves like more noise,
which the fit finds and states: halves by chance agree whatever the kinematics lack, and differ where the readings of a
pose err together. Halves that a joint's reading divides, or the time, are where a wave of that joint, gravity or a
drift pull them apart. Ours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

By = Literal["chance", "order", "reading", "middle"]


@dataclass(frozen=True, slots=True)
class Division:
    """Two halves of some poses.

    by: chance; the order of the file (first half, second half); the reading of a joint (lower, higher; or in the middle
    of its readings and towards their ends). joint: its number, from 1; 0 without one. first: mask of the first half,
    shape (N,).
    """

    by: By
    joint: int
    first: Mask

    @property
    def name(self) -> str:
        """What it is called in tables."""
        if self.by in ("chance", "order"):
            return self.by
        return f"joint {self.joint}" if self.by == "reading" else f"joint {self.joint}, middle"

    @property
    def said(self) -> str:
        """Which halves they are, in words."""
        return {
            "chance": "drawn by chance",
            "order": "the first and the last in the file",
            "reading": f"divided at the median of joint {self.joint}",
            "middle": f"divided by whether joint {self.joint} is near its median",
        }[self.by]


def divisions(data: Dataset, read: Mask, rng: np.random.Generator) -> Iterator[Division]:
    """Halves of the poses, that by chance first; poses that the same instruments have read are divided evenly, so that
    both halves see all places.

    Args:
        read: which observations have read a pose, shape (N, o). rng: draws that by chance, and which pose of equal ones
            goes first.
    """
    _, strata = np.unique(read, axis=0, return_inverse=True)
    strata = strata.reshape(-1)
    count = len(data)
    by_chance = rng.permutation(count).astype(float)
    yield Division("chance", 0, _halved(by_chance, by_chance, strata))
    yield Division("order", 0, _halved(np.arange(count, dtype=np.float64), by_chance, strata))
    for i, reading in enumerate(data.q.T, start=1):
        ways: tuple[tuple[By, Array], ...] = (("reading", reading), ("middle", np.abs(reading - np.median(reading))))
        for by, value in ways:
            if np.ptp(value) > 0:
                yield Division(by, i, _halved(value, by_chance, strata))


def _halved(value: Array, tie: Array, strata: NDArray[np.intp]) -> Mask:
    """The lower half of every stratum, ties in a given order; odd ones are left to either half in turn."""
    first = np.zeros(len(value), dtype=np.bool_)
    spare = 0
    for stratum in range(int(strata.max(initial=-1)) + 1):
        own = np.flatnonzero(strata == stratum)
        order = own[np.lexsort((tie[own], value[own]))]
        half = len(order) // 2
        if len(order) % 2:
            half += spare
            spare = 1 - spare
        first[order[:half]] = True
    return first
