"""What random plans of the same size promise: what a plan that was searched is compared with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.planning.accuracy_forecast.prediction import REGION_SAMPLE
from symcal.planning.area import draw
from symcal.planning.information import PoseInformation
from symcal.planning.methods import SearchTask, random_plan
from symcal.planning.packed import packed_squares, packed_weight
from symcal.planning.region import Accuracy
from symcal.planning.worst_pose import feasible_set

Array = NDArray[np.float64]

_CHUNK = 1024  # poses of a sample at once: bounds the memory
_SINGULAR = 1e14


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
    drawn = _drawn(task, plans, rng)
    posteriors = _posteriors(info, task, drawn)
    d, g = _efficiencies(info, task, logdet_upper_bound, drawn)
    means, worst = _means(accuracy, posteriors), _worst(accuracy, posteriors, rng)
    d_, g_, mean, highest = (float(np.median(each)) for each in (d, g, means, worst))
    return RandomPlans(plans, d_, g_, mean, highest)


def typical_errors(
    info: PoseInformation, accuracy: Accuracy, task: SearchTask, plans: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Medians over random plans of the rms error over the region and at its worst pose, mm, as in `RandomPlans`."""
    posteriors = _posteriors(info, task, _drawn(task, plans, rng))
    return float(np.median(_means(accuracy, posteriors))), float(np.median(_worst(accuracy, posteriors, rng)))


def typical_mean(
    info: PoseInformation, accuracy: Accuracy, task: SearchTask, plans: int, rng: np.random.Generator
) -> float:
    """The first of `typical_errors` alone, which costs next to nothing."""
    return float(np.median(_means(accuracy, _posteriors(info, task, _drawn(task, plans, rng)))))


def _drawn(task: SearchTask, plans: int, rng: np.random.Generator) -> Array:
    """Random plans, shape (plans, count, dof)."""
    if task.where.area is None or task.distance > 0:
        return np.array([random_plan(task, rng, lambda _: None) for _ in range(plans)])
    poses = draw(task.where.area, rng, plans * task.count, task.feasible)
    return poses.reshape(plans, task.count, -1)


def _posteriors(info: PoseInformation, task: SearchTask, drawn: Array) -> Array:
    """R^-1 of each plan, required poses included, shape (plans, p, p)."""
    must = info.function.full(task.required).reshape(-1, len(info.names))
    rows = (info.function.full(poses).reshape(-1, len(info.names)) for poses in drawn)
    return np.array([info.posterior_of(np.vstack([must, each])) for each in rows])


def _means(accuracy: Accuracy, posteriors: Array) -> Array:
    return np.array([accuracy.mean_rms(posterior) for posterior in posteriors])


def _worst(accuracy: Accuracy, posteriors: Array, rng: np.random.Generator) -> Array:
    region = accuracy.region
    spread = region.poses
    if region.area is not None:
        spread = feasible_set(region.area, rng, REGION_SAMPLE, region.feasible).sample
    covariances = posteriors @ posteriors.swapaxes(-1, -2)
    return np.sqrt(np.maximum(_largest(accuracy.everything.full(spread), covariances), 0.0))


def _efficiencies(
    info: PoseInformation, task: SearchTask, logdet_upper_bound: float, drawn: Array
) -> tuple[Array, Array]:
    """D and G of each plan, zero for a plan that leaves a direction undetermined."""
    n, count = info.rank, task.count + len(task.required)
    fixed = info.total(task.required) - info.prior
    matrices = np.array([(fixed + info.total(poses)) / count for poses in drawn])
    sign, logdet = np.linalg.slogdet(matrices)
    regular = (sign > 0) & np.isfinite(logdet) & (np.linalg.cond(matrices) <= _SINGULAR)
    d, g = np.zeros(len(drawn)), np.zeros(len(drawn))
    if regular.any():
        inverses = np.linalg.inv(matrices[regular])
        seen = _largest(info.rows(task.where.sample), inverses)
        d[regular] = np.exp((logdet[regular] - logdet_upper_bound) / n)
        g[regular] = n / (seen + np.sum(inverses * info.prior, axis=(1, 2)) / count)
    return d, g


def _largest(rows: Array, weights: Array) -> Array:
    """max_k tr(F_k W F_k^T) for each W, shape (plans,); poses without finite rows are passed over.

    Args:
        rows: F, shape (K, m, n). weights: W, symmetric, shape (plans, n, n).
    """
    rows = rows[np.isfinite(rows).all(axis=(1, 2))]
    columns = packed_weight(weights).T
    out = np.full(len(weights), -np.inf)
    for i in range(0, len(rows), _CHUNK):
        out = np.maximum(out, (packed_squares(rows[i : i + _CHUNK]) @ columns).max(axis=0))
    return out
