"""How much random plans of one size differ: quantiles of their predicted errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.planning.area import Feasible, draw
from symcal.planning.information import PoseInformation
from symcal.planning.region import Accuracy

Array = NDArray[np.float64]

LOW, HIGH = 0.05, 0.95
"""Between these quantiles lie nine tenths of the random plans."""


@dataclass(frozen=True, slots=True)
class RandomBand:
    """Quantiles of the predicted mean error over the region, mm, by number of poses."""

    counts: tuple[int, ...]
    low_mm: tuple[float, ...]
    median_mm: tuple[float, ...]
    high_mm: tuple[float, ...]
    plans: int


def random_band(
    info: PoseInformation,
    accuracy: Accuracy,
    counts: Sequence[int],
    plans: int,
    rng: np.random.Generator,
    *,
    feasible: Feasible | None = None,
) -> RandomBand:
    """Draw random plans of every size, uniform over the feasible part of the working area.

    Args:
        counts: numbers of poses. plans: per number.
    """
    pool = draw(info.area, rng, max(counts) * min(plans, 50), feasible)
    rows = info.function.full(pool)
    errors = np.full((len(counts), plans), np.inf)
    for i, count in enumerate(counts):
        for k in range(plans):
            chosen = rows[rng.integers(len(pool), size=count)].reshape(-1, len(info.names))
            errors[i, k] = accuracy.mean_rms(info.posterior_of(chosen))
    low, median, high = np.quantile(errors, [LOW, 0.5, HIGH], axis=1, method="nearest")
    return RandomBand(tuple(counts), tuple(low.tolist()), tuple(median.tolist()), tuple(high.tolist()), plans)
