"""From a design to a plan: every atom its share, and never a plan that is worse than before."""

from __future__ import annotations

import numpy as np
import pytest
from planning_cases import fr3, handling

from symcal.planning.criteria import criterion
from symcal.planning.methods import SearchTask, combined_plan, improve, plan_of, rounded
from symcal.planning.optimal_design import optimal_design
from symcal.planning.worst_pose import feasible_set


def nobody(poses):
    del poses


def ready(info, count, rng, *, feasible=None, distance=0.0):
    """A task, and the design that its bound comes from."""
    where = feasible_set(info.area, rng, 800, feasible)
    merit = criterion("D")
    task = SearchTask(info, merit, count, info.prior, where, np.zeros((0, info.area.dof)), distance)
    return task, optimal_design(info, merit, where, info.prior / count, where.sample[:200], rng, tolerance=2e-3)


def test_every_atom_is_taken_as_often_as_its_share_says(rng):
    atoms, weights = np.arange(9.0)[:, None], rng.dirichlet(np.full(9, 0.5))
    often = np.zeros(9)
    for _ in range(4000):
        taken = rounded(atoms, weights, 7, rng)[:, 0].astype(int)
        times = np.bincount(taken, minlength=9)
        assert times.sum() == 7
        assert (times >= np.floor(7 * weights - 1e-9)).all()
        assert (times <= np.ceil(7 * weights + 1e-9)).all()
        often += times
    # means of counts with a variance below 1/4
    np.testing.assert_allclose(often / 4000, 7 * weights, atol=5 * 0.5 / np.sqrt(4000))


@pytest.mark.parametrize(("make", "start"), [(handling, "random"), (fr3, "combined")])
def test_improving_a_plan_never_makes_it_worse_and_never_beats_the_bound(make, start, rng):
    info = make()
    task, design = ready(info, 30, rng)
    poses = info.area.sample(rng, 30) if start == "random" else combined_plan(task, rng, nobody)
    better = improve(task, poses, design, rng, nobody)
    bound = task.criterion.score(30 * design.matrix) + np.log1p(design.excess)
    assert better.shape == poses.shape
    assert info.area.contains(better).all()
    assert task.score(poses) <= task.score(better) <= bound + 1e-9
    assert task.score(better) > bound - 0.02


def test_improved_plans_keep_constraints_and_distances(rng):
    info = handling()
    low = lambda q: q[:, 1] + 100 * np.sin(q[:, 3]) < 1000.0  # noqa: E731
    task, design = ready(info, 20, rng, feasible=low)
    poses = task.where.sample[:20]
    better = improve(task, poses, design, rng, nobody)
    assert low(better).all()
    assert task.score(better) > task.score(poses)
    apart, design = ready(info, 12, rng, distance=0.4)
    poses = combined_plan(apart, rng, nobody)
    unit = info.area.unit(improve(apart, poses, design, rng, nobody))
    assert (np.linalg.norm(unit[:, None] - unit[None], axis=2) + 10 * np.eye(12)).min() >= 0.4


def test_a_design_is_a_plan_where_there_are_many_poses(rng):
    info = handling()
    task, design = ready(info, 500, rng)
    plan = plan_of(task, design, rng)
    assert plan is not None
    assert plan.shape == (500, info.area.dof)
    assert info.area.contains(plan).all()
    searched = combined_plan(task, rng, nobody)
    assert task.score(plan) > task.score(searched) - 1e-3
    few, design = ready(info, 6, rng)
    assert plan_of(few, design, rng) is None
