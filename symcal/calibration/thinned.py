"""A few thousand poses that stand for very many, where something is looked for and nothing estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors
from symcal.data.dataset import SOME, Dataset, evenly

LISTED = 10_000
"""Poses whose errors are listed one by one; a list of a million is read by nobody and has 300 MB."""


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


def listed(found: Errors) -> Errors:
    """The errors of at most `LISTED` poses, evenly spread: those that stand one by one in a table."""
    count = int(found.pose.max(initial=-1)) + 1
    if count <= LISTED:
        return found
    kept = np.isin(found.pose, evenly(count, LISTED))
    return replace(
        found,
        vectors=found.vectors[kept],
        pose=found.pose[kept],
        point=found.point[kept],
        rotations=None if found.rotations is None else found.rotations[kept],
    )


def listed_notes(data: Dataset) -> list[str]:
    """What is said where errors are not listed of all poses."""
    most = max((data.split.count(split) for split in ("train", "test")), default=0)
    if most <= LISTED:
        return []
    return [
        f"errors.csv lists {LISTED} of the {most} poses, evenly spread; rms, mean, p95 and max are of all, and "
        "outliers are looked for among all"
    ]


def few_folds(used: Dataset) -> list[str]:
    """What is said where a cross-validation takes its folds from `Dataset.few` of the poses that are used."""
    if len(used) <= SOME:
        return []
    return [
        f"the cross-validation is of {SOME} of the {len(used)} poses, evenly spread: each fold is identified from its "
        "share of these, and so a little worse than from all"
    ]


def thinned_notes(data: Dataset) -> list[str]:
    """What is said where that was done."""
    count = data.split.count("train")
    if count <= SOME:
        return []
    return [
        f"the check of the model and the two halves look at {SOME} of the {count} training poses, evenly spread; the "
        "estimate, its uncertainty and the noise are of all"
    ]
