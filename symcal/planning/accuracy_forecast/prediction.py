"""What a plan promises: the tool error of an identification, over a task region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.planning.region import Accuracy
from symcal.planning.worst_pose import FeasibleSet, feasible_set, largest

Array = NDArray[np.float64]

REGION_SAMPLE = 5000
"""Poses of a region in which its worst is looked for."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """Expected rms position error after identification, mm: root mean square over the region, and at its worst pose.

    hidden_mm: the part of directions that the measurement cannot see, see `symcal.planning.region.Accuracy`.
    """

    mean_pose_rms_mm: float
    worst_pose_rms_mm: float
    worst_pose: Array
    hidden_mm: float


def predict(accuracy: Accuracy, posterior: Array, rng: np.random.Generator) -> Prediction:
    """Predicted error for a plan with posterior R^-1, shape (p, p); the worst pose is searched with polish."""
    region = accuracy.region
    if region.area is None:
        where = FeasibleSet(region.poses, None)
    else:
        where = feasible_set(region.area, rng, REGION_SAMPLE, region.feasible)
    values, poses = largest(accuracy.everything, posterior @ posterior.T, where, rng, thorough=True)
    return Prediction(accuracy.mean_rms(posterior), float(np.sqrt(values[0])), poses[0], accuracy.hidden_mm)
