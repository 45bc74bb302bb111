"""The genetic algorithm on whole planning tasks, judged by the certificate."""

from __future__ import annotations

import numpy as np
import pytest
from handling_arm import front_view
from planning_cases import handling

from symcal.errors import RefusedError
from symcal.planning.certificate import certify
from symcal.planning.constraints import feasible
from symcal.planning.coverage import nearest_distance
from symcal.planning.criteria import criterion
from symcal.planning.genetic_method import genetic_plan
from symcal.planning.methods import SearchTask
from symcal.planning.visibility import visibility
from symcal.planning.worst_pose import FeasibleSet, feasible_set

D = criterion("D")


def nothing(_):
    return None


def task_of(info, where, count=40, required=None, distance=0.0):
    required = np.zeros((0, 5)) if required is None else required
    return SearchTask(info, D, count, info.total(required), where, required, distance)


@pytest.mark.parametrize("coding", ["binary", "real"])
def test_sound_fitness_reaches_the_bound_of_the_certificate(coding):
    info = handling()
    where = feasible_set(info.area, np.random.default_rng(0), 5000)
    told = []
    result = genetic_plan(task_of(info, where), np.random.default_rng(1), told.append, coding=coding)
    proof = certify(info, result.poses, D, where, np.random.default_rng(2))
    assert proof.d_efficiency_lower_bound >= 0.98
    assert len(told) == 201
    np.testing.assert_array_equal(told[-1], result.poses)


@pytest.mark.parametrize("coding", ["binary", "real"])
def test_plans_that_a_camera_sees_stay_visible_and_beat_random_ones(coding):
    info = handling()
    constraints = visibility(front_view(info.measurement.chain), margin=10.0)
    mask = feasible(constraints)
    where = feasible_set(info.area, np.random.default_rng(0), 2000, mask)
    task = task_of(info, where, 20)
    result = genetic_plan(
        task, np.random.default_rng(1), nothing, constraints=constraints, coding=coding, population=100, generations=60
    )
    assert mask(result.poses).all()
    random = [task.score(where.sample[i : i + 20]) for i in range(0, 1000, 20)]
    assert task.score(result.poses) > max(random)


def test_required_poses_count_and_distances_hold():
    info = handling()
    where = feasible_set(info.area, np.random.default_rng(0), 2000)
    required = info.area.sample(np.random.default_rng(5), 3)
    task = task_of(info, where, 10, required, distance=0.4)
    result = genetic_plan(task, np.random.default_rng(1), nothing, population=60, generations=40)
    assert result.poses.shape == (10, 5)
    whole = np.concatenate([required, result.poses])
    inner = nearest_distance(whole, info.area)[3:]
    assert np.all(inner >= 0.4 - 1e-9)
    assert -result.fitness == pytest.approx(float(D.score(info.total(whole))))


def test_a_fitness_of_its_own_sees_complete_plans():
    info = handling()
    required = info.area.sample(np.random.default_rng(5), 3)
    task = task_of(info, feasible_set(info.area, np.random.default_rng(0), 500), 4, required)

    def waist_range(plans):
        assert np.array_equal(plans[0, :3], required)
        return -np.ptp(plans[:, :, 0], axis=1)

    result = genetic_plan(task, np.random.default_rng(0), nothing, fitness=waist_range, population=20, generations=20)
    assert result.fitness == pytest.approx(-np.ptp(np.concatenate([required, result.poses])[:, 0]))


def test_candidates_are_for_other_methods():
    info = handling()
    with pytest.raises(RefusedError, match="finite"):
        genetic_plan(task_of(info, FeasibleSet(info.area.even(50), None)), np.random.default_rng(0), nothing)
