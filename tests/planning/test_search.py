"""Plans: how good they provably are, that they keep what is asked of them, and that a seed gives one plan."""

from __future__ import annotations

import numpy as np
import pytest
from planning_cases import SIGMA, fr3, handling

from symcal.errors import InputError, RefusedError
from symcal.planning.search import select_poses


@pytest.fixture(scope="module")
def reference():
    return select_poses(handling(), 40, np.random.default_rng(7))


def test_reference_plan_is_provably_near_the_optimum(reference):
    assert reference.certificate.d_efficiency_lower_bound >= 0.995
    assert reference.certificate.g_efficiency >= 0.97
    assert reference.prediction.worst_pose_rms_mm <= 1.02 * SIGMA * np.sqrt(11 / 40)
    assert reference.rank == 11
    assert reference.history[-1][1] == pytest.approx(reference.value)


def test_random_plans_stand_beside_it(reference):
    """Medians of 200 random plans of the reference case: D about 0.55, G about 0.36."""
    assert reference.random.plans == 200
    assert reference.random.d_efficiency_lower_bound == pytest.approx(0.55, abs=0.03)
    assert reference.random.g_efficiency == pytest.approx(0.36, abs=0.04)
    assert reference.random.mean_pose_rms_mm > reference.prediction.mean_pose_rms_mm
    assert reference.random.worst_pose_rms_mm > 1.3 * reference.prediction.worst_pose_rms_mm


def test_worst_pose_of_positions_follows_the_equivalence_theorem(reference):
    """Measured and asked about over the same area: worst^2 = sigma^2 n / (N G)."""
    wanted = SIGMA * np.sqrt(11 / 40 / reference.certificate.g_efficiency)
    assert reference.prediction.worst_pose_rms_mm == pytest.approx(wanted, rel=2e-3)


def test_seven_axis_arm_seen_by_poses():
    plan = select_poses(fr3(), 40, np.random.default_rng(1), method="combined", random=0, sample=3000)
    assert plan.certificate.d_efficiency_lower_bound >= 0.97
    assert plan.rank == 34


@pytest.mark.parametrize("method", ["certified", "combined", "exchange", "refine", "random"])
def test_same_seed_same_plan(method):
    plans = [
        select_poses(handling(), 15, np.random.default_rng(5), method=method, random=3, sample=800) for _ in range(2)
    ]
    np.testing.assert_array_equal(plans[0].poses, plans[1].poses)
    assert plans[0].certificate.d_efficiency_lower_bound == plans[1].certificate.d_efficiency_lower_bound
    assert plans[0].random == plans[1].random
    other = select_poses(handling(), 15, np.random.default_rng(6), method=method, random=0, sample=800)
    assert not np.array_equal(plans[0].poses, other.poses)


def test_methods_come_in_their_order():
    found = {
        method: select_poses(handling(), 20, np.random.default_rng(2), method=method, random=0).value
        for method in ("random", "exchange", "combined", "certified")
    }
    assert found["random"] < found["exchange"] <= found["combined"] <= found["certified"] + 1e-9


@pytest.mark.parametrize("method", ["certified", "exchange", "refine", "random"])
def test_constraints_distance_and_required_poses_are_kept(method, rng):
    info = handling()
    feasible = lambda q: q[:, 2] + 200 * np.sin(q[:, 3]) < 500.0  # noqa: E731
    sample = info.area.sample(rng, 200)
    required = sample[feasible(sample)][:2]
    plan = select_poses(
        info,
        14,
        rng,
        method=method,
        feasible=feasible,
        required=required,
        distance=0.2,
        sample=1500,
        random=0,
    )
    np.testing.assert_array_equal(plan.poses[:2], required)
    assert len(plan) == 14
    assert feasible(plan.poses).all()
    assert info.area.contains(plan.poses).all()
    unit = info.area.unit(plan.poses)
    gaps = np.linalg.norm(unit[:, None] - unit[None], axis=2) + 10 * np.eye(14)
    gaps[:2, :2] = 10  # required ones are where the user wants them
    assert gaps.min() >= 0.2


def test_constrained_plan_is_certified_over_its_feasible_set(rng):
    feasible = lambda q: q[:, 2] + 200 * np.sin(q[:, 3]) < 500.0  # noqa: E731
    plan = select_poses(handling(), 40, rng, feasible=feasible, random=0)
    assert plan.certificate.d_efficiency_lower_bound >= 0.97
    assert feasible(plan.certificate.worst_pose[None]).all()


def test_required_pose_that_cannot_be_measured_is_named(rng):
    required = handling().area.sample(rng, 3)
    required[1, 2] = 1e4
    with pytest.raises(InputError, match="cannot be measured: 2"):
        select_poses(handling(), 10, rng, required=required)


@pytest.mark.parametrize("criterion", ["A", "E", "I", "O5", "G", "cond"])
def test_every_criterion_improves_on_random_plans(criterion, rng):
    options = {"criterion": criterion, "random": 0, "sample": 600}
    best = select_poses(handling(), 15, rng, method="combined", **options)
    other = select_poses(handling(), 15, rng, method="random", **options)
    better = best.value > other.value if criterion in ("E", "O5") else best.value < other.value
    assert better


def test_candidates_are_chosen_once_each_by_place(rng):
    candidates = handling().area.sample(rng, 120)
    candidates[7] = candidates[3]
    plan = select_poses(handling(), 30, rng, candidates=candidates, criterion="D", random=20)
    assert len(set(plan.indices.tolist())) == 30
    np.testing.assert_array_equal(plan.poses, candidates[plan.indices])
    assert plan.certificate.exhaustive
    assert plan.certificate.d_efficiency_lower_bound > plan.random.d_efficiency_lower_bound
    with pytest.raises(RefusedError, match="121 poses are wanted"):
        select_poses(handling(), 121, rng, candidates=candidates, criterion="D")


def test_too_few_poses_and_unknown_methods_are_refused(rng):
    with pytest.raises(RefusedError, match="at least 4 poses"):
        select_poses(handling(), 3, rng)
    with pytest.raises(InputError, match="did you mean 'exchange'"):
        select_poses(handling(), 10, rng, method="exchnge")


def test_more_poses_than_the_plan_has_cannot_be_required(rng):
    with pytest.raises(InputError, match="required"):
        select_poses(handling(), 5, rng, required=handling().area.sample(rng, 6))
