"""Promises: bound below best below random, the law of large numbers, and an honest answer to 'how many'."""

from __future__ import annotations

import numpy as np
import pytest
from planning_cases import SIGMA, handling

from symcal import kinematics
from symcal.errors import InputError, RefusedError
from symcal.model.measurement import Setup
from symcal.model.observe import observe
from symcal.model.parameter_set import parameter_set
from symcal.model.task import Task
from symcal.planning.accuracy_forecast.forecast import forecast, poses_needed
from symcal.planning.accuracy_forecast.prediction import REGION_SAMPLE
from symcal.planning.accuracy_forecast.random_plans import random_plans
from symcal.planning.area import draw
from symcal.planning.criteria import criterion
from symcal.planning.information import pose_information
from symcal.planning.methods import SearchTask
from symcal.planning.region import area_region, region_accuracy
from symcal.planning.worst_pose import feasible_set


@pytest.fixture(scope="module")
def promised():
    return forecast(handling(), (10, 20, 40, 160), np.random.default_rng(4), random=20)


def test_bound_is_below_the_best_and_the_best_below_random(promised):
    for bound, best, random in (
        (promised.bound_mean_mm, promised.best_mean_mm, promised.random_mean_mm),
        (promised.bound_worst_mm, promised.best_worst_mm, promised.random_worst_mm),
    ):
        assert all(a <= b + 1e-9 <= c for a, b, c in zip(bound, best, random, strict=True))


def test_bounds_of_positions_are_those_of_the_equivalence_theorem(promised):
    wanted = [SIGMA * np.sqrt(11 / n) for n in promised.counts]
    np.testing.assert_allclose(promised.bound_worst_mm, wanted, rtol=5e-3)


def test_many_poses_come_near_the_bound_and_fall_as_their_root(promised):
    assert promised.best_worst_mm[-1] <= 1.03 * promised.bound_worst_mm[-1]
    assert promised.best_mean_mm[2] / promised.best_mean_mm[3] == pytest.approx(2.0, rel=0.03)


@pytest.mark.parametrize("figure", ["mean", "worst"])
def test_poses_needed_keep_the_target_and_fewer_cannot(figure):
    answer = poses_needed(handling(), 0.045, np.random.default_rng(1), figure=figure)
    errors = answer.prediction
    assert (errors.mean_pose_rms_mm if figure == "mean" else errors.worst_pose_rms_mm) <= 0.045
    assert answer.at_least <= answer.count <= answer.at_least + 3
    assert answer.poses.shape == (answer.count, 5)
    assert answer.random > answer.count
    if figure == "worst":
        assert answer.at_least == pytest.approx(11 * (SIGMA / 0.045) ** 2, abs=1)


def test_priors_lower_the_bound():
    robot = handling().measurement.chain.robot
    parameters = parameter_set(robot)
    tight = parameters.with_priors(dict.fromkeys(parameters.names, 1e-5))
    measurement = observe(kinematics.chain(robot, tight), *Task.of("position").observations)
    setup = Setup(robot.base, robot.tool, np.zeros((1, 3)))
    info = pose_information(measurement, setup, {"position": SIGMA}, area=handling().area)
    answer = forecast(info, (10, 40), np.random.default_rng(0), random=5)
    assert answer.bound_mean_mm[0] <= answer.best_mean_mm[0] < 0.02
    assert answer.bound_worst_mm[1] <= answer.best_worst_mm[1]


def test_targets_that_cannot_be_reached_are_refused(rng):
    with pytest.raises(RefusedError, match="measure more precisely"):
        poses_needed(handling(), 0.001, rng)
    with pytest.raises(InputError, match="positive"):
        poses_needed(handling(), 0.0, rng)
    with pytest.raises(RefusedError, match="take 4 or more"):
        forecast(handling(), (3,), rng)


def test_random_plans_at_once_are_random_plans_one_by_one():
    info = handling()
    accuracy = region_accuracy(info, area_region(info.area, np.random.default_rng(3), count=500))
    where = feasible_set(info.area, np.random.default_rng(4), 400)
    task = SearchTask(info, criterion("D"), 12, info.prior, where, np.zeros((0, 5)))
    found = random_plans(info, accuracy, task, 13.0, 9, np.random.default_rng(5))
    rng = np.random.default_rng(5)
    plans = draw(info.area, rng, 9 * 12).reshape(9, 12, 5)
    spread = feasible_set(info.area, rng, REGION_SAMPLE).sample
    each = []
    for plan in plans:
        matrix, posterior = info.total(plan) / 12, info.posterior(plan)
        highest = max(np.trace(i @ np.linalg.inv(matrix)) for i in info.matrices(where.sample))
        d = np.exp((np.linalg.slogdet(matrix)[1] - 13.0) / 11)
        each.append((d, 11 / highest, accuracy.mean_rms(posterior), accuracy.at(spread, posterior).max()))
    middle = (found.d_efficiency_lower_bound, found.g_efficiency, found.mean_pose_rms_mm, found.worst_pose_rms_mm)
    np.testing.assert_allclose(middle, np.median(each, axis=0), rtol=1e-8)
