"""What a plan promises: the tool error of an identification, over a task region."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.planning.region import Accuracy
from symcal.planning.worst_pose import STARTS, FeasibleSet, feasible_set, largest, maxima

Array = NDArray[np.float64]

REGION_SAMPLE = 5000
"""Poses of a region in which its worst is looked for."""

_MAXIMA = 60  # of a plan, from which those of the next one are looked for


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
    (prediction,) = predictions(accuracy, [posterior], rng)
    return prediction


def predictions(accuracy: Accuracy, posteriors: Sequence[Array], rng: np.random.Generator) -> list[Prediction]:
    """The same for plans of one measurement: the worst pose of the first is searched thoroughly, those of the others
    from where the maxima of the plan before were, and from the best of one sample."""
    region, function = accuracy.region, accuracy.everything
    if region.area is None:
        where = FeasibleSet(region.poses, None)
    else:
        where = feasible_set(region.area, rng, REGION_SAMPLE, region.feasible)
    out: list[Prediction] = []
    known = where.sample[:0]
    for posterior in posteriors:
        weight = posterior @ posterior.T
        if not out:
            values, poses = largest(function, weight, where, rng, thorough=True)
        else:
            values, poses = maxima(function, weight, where, rng, known, STARTS)
        known = poses[:_MAXIMA]
        out.append(Prediction(accuracy.mean_rms(posterior), float(np.sqrt(values[0])), poses[0], accuracy.hidden_mm))
    return out
