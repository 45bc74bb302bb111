"""What a plan promises: the tool error of an identification, over a task region; and the same for random plans."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.planning.information import PoseInformation
from symcal.planning.methods import SearchTask, random_plan
from symcal.planning.region import Accuracy
from symcal.planning.worst_pose import FeasibleSet, feasible_set, largest

Array = NDArray[np.float64]

_SAMPLE = 5000  # poses of a region in which its worst is looked for


@dataclass(frozen=True, slots=True)
class Prediction:
    """Expected rms position error after identification, mm: root mean square over the region, and at its worst pose.

    hidden_mm: the part of directions that the measurement cannot see, see `symcal.planning.region.Accuracy`.
    """

    mean_pose_rms_mm: float
    worst_pose_rms_mm: float
    worst_pose: Array
    hidden_mm: float


@dataclass(frozen=True, slots=True)
class RandomPlans:
    """Medians over random plans of the same size, drawn uniformly from the feasible set.

    The worst poses are looked for in the samples alone, without polish, so errors are a little too small and G a little
    too large here: in favour of the random plans.
    """

    plans: int
    d_efficiency_lower_bound: float
    g_efficiency: float
    mean_pose_rms_mm: float
    worst_pose_rms_mm: float


def predict(accuracy: Accuracy, posterior: Array, rng: np.random.Generator) -> Prediction:
    """Predicted error for a plan with posterior R^-1, shape (p, p); the worst pose is searched with polish."""
    region = accuracy.region
    if region.area is None:
        where = FeasibleSet(region.poses, None)
    else:
        where = feasible_set(region.area, rng, _SAMPLE, region.feasible)
    values, poses = largest(accuracy.everything, posterior @ posterior.T, where, rng, thorough=True)
    return Prediction(accuracy.mean_rms(posterior), float(np.sqrt(values[0])), poses[0], accuracy.hidden_mm)


def random_plans(
    info: PoseInformation,
    accuracy: Accuracy,
    task: SearchTask,
    logdet_upper_bound: float,
    plans: int,
    rng: np.random.Generator,
) -> RandomPlans:
    """Medians over random plans for the same task (required poses included).

    Args:
        logdet_upper_bound: the certificate's, of log det of the mean information per pose.
    """
    n, count = info.rank, task.count + len(task.required)
    there = info.rows(task.where.sample).reshape(-1, n)
    region = accuracy.region
    spread = region.poses if region.area is None else feasible_set(region.area, rng, _SAMPLE, region.feasible).sample
    asked = accuracy.everything.full(spread)
    parts = asked.shape[1]
    asked = asked.reshape(-1, len(info.names))
    fixed, must = info.total(task.required), info.function.full(task.required).reshape(-1, len(info.names))
    figures = np.zeros((plans, 4))
    for i in range(plans):
        poses = random_plan(task, rng, lambda _: None)
        everything = info.function.full(poses).reshape(-1, len(info.names))
        rows = everything @ info.basis
        matrix = (fixed + rows.T @ rows) / count
        posterior = info.posterior_of(np.vstack([must, everything]))
        errors = np.sum((asked @ posterior) ** 2, axis=1).reshape(-1, parts).sum(axis=1)
        figures[i, 2:] = accuracy.mean_rms(posterior), np.sqrt(errors.max())
        sign, logdet = np.linalg.slogdet(matrix)
        if sign <= 0 or not np.isfinite(logdet) or np.linalg.cond(matrix) > _SINGULAR:
            continue  # efficiencies of a plan that leaves a direction undetermined are zero
        inverse = np.linalg.inv(matrix)
        seen = np.einsum("ki,ki->k", there @ inverse, there).reshape(-1, info.components).sum(axis=1)
        figures[i, 0] = np.exp((logdet - logdet_upper_bound) / n)
        figures[i, 1] = n / (seen.max() + np.sum(inverse * info.prior) / count)
    middle = np.median(figures, axis=0)
    return RandomPlans(plans, float(middle[0]), float(middle[1]), float(middle[2]), float(middle[3]))


_SINGULAR = 1e14
