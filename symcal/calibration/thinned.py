"""A few thousand poses that stand for very many, where something is looked for and nothing estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from symcal.calibration.calibrate import Calibration
from symcal.data.dataset import SOME, Dataset, evenly


def thinned(calibration: Calibration, data: Dataset) -> tuple[Calibration, Dataset]:
    """The same with at most `SOME` of the training poses, evenly spread in their order; the others are `unused`.

    The estimate, its covariance and its noise stay those of all poses.

    Args:
        data: what the calibration is of.
    """
    train = np.flatnonzero([split == "train" for split in data.split])
    if len(train) <= SOME:
        return calibration, data
    kept = evenly(len(train))
    split = np.array(data.split, dtype=object)
    split[np.delete(train, kept)] = "unused"
    after = replace(calibration.after, weights=calibration.after.weights[kept])
    return replace(calibration, after=after), replace(data, split=tuple(split))


def thinned_notes(data: Dataset) -> list[str]:
    """What is said where that was done."""
    count = data.split.count("train")
    if count <= SOME:
        return []
    return [
        f"the check of the model and the two halves look at {SOME} of the {count} training poses, evenly spread; the "
        "estimate, its uncertainty and the noise are of all"
    ]
