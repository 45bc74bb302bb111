"""How accurate N poses will make the robot, and how many are needed: predictions with a bound that no plan can beat."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError, RefusedError
from symcal.planning.accuracy_forecast.error_floor import ErrorFloor, error_floor
from symcal.planning.accuracy_forecast.prediction import Prediction, predict, predictions
from symcal.planning.accuracy_forecast.random_plans import typical_errors, typical_mean
from symcal.planning.area import Feasible
from symcal.planning.criteria import criterion
from symcal.planning.information import PoseInformation
from symcal.planning.methods import METHODS, SearchTask, fewest_poses, plan_from, plan_of
from symcal.planning.optimal_design import ApproximateDesign
from symcal.planning.region import Accuracy, TaskRegion, area_region, region_accuracy
from symcal.planning.worst_pose import FeasibleSet, feasible_set

Array = NDArray[np.float64]
Figure = Literal["mean", "worst"]

LARGEST_PLAN = 1000
"""Poses beyond which `poses_needed` gives up: hardly anybody measures more."""

_ENOUGH = 2  # times as many numbers as directions: with fewer, the best poses are others than those of a design
_MANY = 10  # poses per direction from which a plan is made from a design rather than by exchange
_TYPICAL = 100  # random plans per number of poses that is tried
_SAMPLE = 2500  # poses that stand for the feasible set: fewer than for one plan, since many are made here


@dataclass(frozen=True, slots=True)
class Ground:
    """What every promise for one measurement and region stands on, whatever the number of poses; made by `ground`."""

    accuracy: Accuracy
    where: FeasibleSet
    floor: ErrorFloor


@dataclass(frozen=True, slots=True)
class Forecast:
    """Predicted rms position errors in mm against the number of poses, by the posterior of an identification.

    counts: numbers of poses. Per number, over the region and at its worst pose: of the best plan found, the median of
    random plans, and a bound that no plan is below (up to what the search of a maximum misses).
    hidden_mm: the part of all of them that comes from directions that the measurement cannot see.
    """

    counts: tuple[int, ...]
    best_mean_mm: tuple[float, ...]
    best_worst_mm: tuple[float, ...]
    random_mean_mm: tuple[float, ...]
    random_worst_mm: tuple[float, ...]
    bound_mean_mm: tuple[float, ...]
    bound_worst_mm: tuple[float, ...]
    hidden_mm: float


@dataclass(frozen=True, slots=True)
class PosesNeeded:
    """The answer to 'how many poses do I need for this error?'.

    count: the smallest number for which a plan was found that keeps the target; poses: that plan, shape (count, dof),
    and what it promises. at_least: fewer cannot do, whatever the plan, as far as the bound was searched.
    random: poses with which the median of random plans keeps it; None if more than `LARGEST_PLAN`.
    """

    target_mm: float
    figure: Figure
    count: int
    at_least: int
    random: int | None
    poses: Array
    prediction: Prediction


def forecast(
    info: PoseInformation,
    counts: Sequence[int],
    rng: np.random.Generator,
    *,
    method: str = "combined",
    objective: str = "D",
    region: TaskRegion | None = None,
    aligned: bool = False,
    feasible: Feasible | None = None,
    random: int = 50,
    known: Ground | None = None,
    progress: Callable[[int], None] | None = None,
) -> Forecast:
    """Predicted errors of the best and of random plans for several numbers of poses.

    Args:
        counts: numbers of poses, each enough to determine what is identifiable. objective: a criterion. random: plans
            per number. known: the ground, if it was made before. progress: told each number when it is done. Others: as
            for `symcal.planning.search.select_poses`.
    Raises:
        RefusedError: a number of poses is too small.
    """
    for_ground, *for_counts = rng.spawn(1 + len(counts))
    (for_worst,) = rng.spawn(1)
    known = known or ground(info, for_ground, region=region, aligned=aligned, feasible=feasible)
    accuracy, where, floor = known.accuracy, known.where, known.floor
    posteriors, others = [], []
    for count, own in zip(counts, for_counts, strict=True):
        if count < fewest_poses(info):
            raise RefusedError(
                f"{count} poses do not determine {info.rank} directions: take {fewest_poses(info)} or more"
            )
        task = _task(info, accuracy, where, objective, count)
        posteriors.append(info.posterior(_searched(task, method, floor, own)))
        others.append(typical_errors(info, accuracy, task, random, own))
        if progress is not None:
            progress(count)
    # from the largest plan on, whose worst pose is the one that the bound is about
    best = predictions(accuracy, posteriors[::-1], for_worst)[::-1]
    return Forecast(
        counts=tuple(counts),
        best_mean_mm=tuple(p.mean_pose_rms_mm for p in best),
        best_worst_mm=tuple(p.worst_pose_rms_mm for p in best),
        random_mean_mm=tuple(mean for mean, _ in others),
        random_worst_mm=tuple(worst for _, worst in others),
        bound_mean_mm=tuple(floor.mean(count) for count in counts),
        bound_worst_mm=tuple(floor.worst(count) for count in counts),
        hidden_mm=accuracy.hidden_mm,
    )


def poses_needed(
    info: PoseInformation,
    target_mm: float,
    rng: np.random.Generator,
    *,
    figure: Figure = "mean",
    method: str = "combined",
    objective: str | None = None,
    region: TaskRegion | None = None,
    aligned: bool = False,
    feasible: Feasible | None = None,
    known: Ground | None = None,
) -> PosesNeeded:
    """How many poses bring the predicted error down to a target.

    Args:
        target_mm: largest rms position error wanted. figure: over the region, or at its worst pose.
        objective: criterion of the plans; I for the mean and D for the worst when None. Others: as for `promise`.
    Raises:
        InputError: a target that is not positive.
        RefusedError: more than `LARGEST_PLAN` poses would be needed.
    """
    if not target_mm > 0:
        raise InputError("the target must be a positive length in mm", key="target", found=target_mm)
    for_ground, for_random, for_search = rng.spawn(3)
    known = known or ground(info, for_ground, region=region, aligned=aligned, feasible=feasible)
    accuracy, where, floor = known.accuracy, known.where, known.floor
    bound = floor.mean if figure == "mean" else floor.worst
    at_least = next((n for n in range(fewest_poses(info), LARGEST_PLAN + 1) if bound(n) <= target_mm), None)
    if at_least is None:
        reached = (
            f"{LARGEST_PLAN} poses cannot bring the {figure} error below {bound(LARGEST_PLAN):.3g} mm at this noise"
        )
        raise RefusedError(f"{reached}: measure more precisely, or ask for less")
    objective = objective or ("I" if figure == "mean" else "D")

    def attempt(count: int) -> tuple[Array, Prediction, float]:
        task = _task(info, accuracy, where, objective, count)
        poses = _searched(task, method, floor, for_search)
        prediction = predict(accuracy, info.posterior(poses), for_search)
        return poses, prediction, _figure(prediction, figure)

    # upward by the law error ~ 1/sqrt(N) until a plan keeps the target, then down to the first number that fails
    count, failed = at_least, at_least - 1
    poses, prediction, error = attempt(count)
    while error > target_mm:
        failed = count
        count = max(count + 1, math.ceil(count * min((error / target_mm) ** 2, 2.0)))
        if count > LARGEST_PLAN:
            raise RefusedError(f"no plan of {LARGEST_PLAN} poses or fewer was found that promises {target_mm:g} mm")
        poses, prediction, error = attempt(count)
    while count - 1 > failed:
        fewer = attempt(count - 1)
        if fewer[2] > target_mm:
            break
        count, (poses, prediction, error) = count - 1, fewer

    def typical(size: int) -> float:
        task = _task(info, accuracy, where, objective, size)
        if figure == "mean":
            return typical_mean(info, accuracy, task, _TYPICAL, for_random)
        return typical_errors(info, accuracy, task, _TYPICAL, for_random)[1]

    return PosesNeeded(
        target_mm=target_mm,
        figure=figure,
        count=count,
        at_least=at_least,
        random=_fewest_random(typical, at_least, target_mm),
        poses=poses,
        prediction=prediction,
    )


def _fewest_random(typical: Callable[[int], float], at_least: int, target_mm: float) -> int | None:
    """The first number of poses whose typical error keeps the target, by doubling and halving; None if beyond
    `LARGEST_PLAN`."""
    failed, enough = at_least - 1, at_least
    while typical(enough) > target_mm:
        if enough == LARGEST_PLAN:
            return None
        failed, enough = enough, min(2 * enough, LARGEST_PLAN)
    while enough - failed > 1:
        middle = (failed + enough) // 2
        if typical(middle) > target_mm:
            failed = middle
        else:
            enough = middle
    return enough


def ground(
    info: PoseInformation,
    rng: np.random.Generator,
    *,
    region: TaskRegion | None = None,
    aligned: bool = False,
    feasible: Feasible | None = None,
    near: ApproximateDesign | None = None,
) -> Ground:
    """Accuracy over the region, a sample of the feasible set, and the bounds that no plan is below.

    Args:
        near: see `symcal.planning.accuracy_forecast.error_floor.error_floor`.
    """
    for_set, for_bound = rng.spawn(2)
    region = area_region(info.area, for_set, feasible=feasible) if region is None else region
    accuracy = region_accuracy(info, region, aligned=aligned)
    where = feasible_set(info.area, for_set, _SAMPLE, feasible)
    return Ground(accuracy, where, error_floor(info, accuracy, where, for_bound, near))


def _task(info: PoseInformation, accuracy: Accuracy, where: FeasibleSet, objective: str, count: int) -> SearchTask:
    merit = criterion(objective, poses=count, accuracy=accuracy)
    return SearchTask(info, merit, count, info.prior, where, np.zeros((0, info.area.dof)))


def _searched(task: SearchTask, method: str, floor: ErrorFloor, rng: np.random.Generator) -> Array:
    """A plan by a search method; the combined one chooses from the floor's design where it has one for the criterion
    and there are poses enough to be like it, and takes it as it is where there are so many that it is as good."""
    design = floor.designs.get(task.criterion.name)
    near = task.count * task.info.components >= _ENOUGH * task.info.rank
    if method != "combined" or design is None or not near:
        return METHODS[method](task, rng, _nobody)
    plan = plan_of(task, design, rng) if task.count >= _MANY * task.info.rank else None
    return plan_from(task, design, rng) if plan is None else plan


def _figure(errors: Prediction, figure: Figure) -> float:
    return errors.mean_pose_rms_mm if figure == "mean" else errors.worst_pose_rms_mm


def _nobody(poses: Array) -> None:
    """Nobody follows these searches."""
