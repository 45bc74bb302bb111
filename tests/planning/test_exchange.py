"""Exchange against complete enumeration, refinement against its own optimality conditions; constraints hold."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from planning_cases import handling

from symcal.errors import RefusedError
from symcal.planning.criteria import criterion
from symcal.planning.exchange import exchange, pool_of
from symcal.planning.refine import refine, walk_back
from symcal.planning.region import area_region, region_accuracy


def sample_pool(info, poses):
    return pool_of(poses, info.rows(poses), info.area.unit(poses))


@pytest.mark.parametrize("name", ["D", "A", "I", "E", "cond"])
def test_exchange_finds_what_enumeration_finds(name, rng):
    info = handling()
    accuracy = region_accuracy(info, area_region(info.area, rng, count=100))
    merit = criterion(name, accuracy=accuracy)
    reached = []
    for _ in range(5):
        pool = sample_pool(info, info.area.sample(rng, 12))
        every = pool.information(np.arange(12))
        sets = np.array(list(itertools.combinations(range(12), 5)))
        best = max(merit.score(every[list(s)].sum(axis=0)) for s in sets)
        chosen = exchange(pool, merit, 5, np.zeros_like(info.prior))
        assert len(set(chosen.tolist())) == 5
        score = merit.score(every[chosen].sum(axis=0))
        assert score <= best + 1e-9
        reached.append(best - score)
    # an exchange stops where no single swap helps: mostly the optimum, never far from it
    assert np.median(reached) < 0.02
    assert max(reached) < 0.5


def test_no_single_swap_improves_the_result(rng):
    info, merit = handling(), criterion("D")
    pool = sample_pool(info, info.area.snapped(rng, 300))
    chosen = exchange(pool, merit, 20, np.zeros_like(info.prior))
    every = pool.information(np.arange(300))
    total = every[chosen].sum(axis=0)
    free = np.setdiff1d(np.arange(300), chosen)
    swapped = max(merit.score(total - every[i] + every[free]).max() for i in chosen)
    assert swapped <= merit.score(total) + 1e-6


def test_distance_between_poses_and_to_required_ones_is_kept(rng):
    info, merit = handling(), criterion("D")
    pool = sample_pool(info, info.area.snapped(rng, 2000))
    off = info.area.unit(info.area.snapped(rng, 3))
    chosen = exchange(pool, merit, 20, np.zeros_like(info.prior), distance=0.5, keep_off=off)
    unit = pool.unit[chosen]
    gaps = np.linalg.norm(unit[:, None] - unit[None], axis=2) + 10 * np.eye(20)
    assert gaps.min() >= 0.5
    assert np.linalg.norm(unit[:, None] - off[None], axis=2).min() >= 0.5
    with pytest.raises(RefusedError, match="only"):
        exchange(pool, merit, 200, np.zeros_like(info.prior), distance=1.0)


def test_repeats_only_if_allowed(rng):
    info, merit = handling(), criterion("D")
    pool = sample_pool(info, info.area.snapped(rng, 15))
    assert len(np.unique(exchange(pool, merit, 15, np.zeros_like(info.prior)))) == 15
    assert len(exchange(pool, merit, 30, np.zeros_like(info.prior), repeats=True)) == 30
    with pytest.raises(RefusedError, match="16 poses are wanted"):
        exchange(pool, merit, 16, np.zeros_like(info.prior))


@pytest.mark.parametrize("name", ["D", "A", "I", "O5"])
def test_refinement_ends_where_no_small_move_helps(name, rng):
    info = handling()
    accuracy = region_accuracy(info, area_region(info.area, rng, count=200))
    merit = criterion(name, accuracy=accuracy)
    start = info.area.sample(rng, 12)
    end = refine(info, merit, start, info.prior, iterations=2000)
    assert merit.score(info.total(end)) > merit.score(info.total(start))
    assert info.area.contains(end).all()
    best = merit.score(info.total(end))
    for radius in (1e-2, 1e-3):
        for _ in range(30):
            near = info.area.clip(end + radius * info.area.span * rng.normal(size=end.shape))
            assert merit.score(info.total(near)) <= best + 1e-5


def test_refinement_keeps_constraints_and_distances(rng):
    info, merit = handling(), criterion("D")
    forbidden = lambda q: q[:, 2] + 200 * np.sin(q[:, 3]) < 450.0  # noqa: E731
    poses = info.area.sample(rng, 4000)
    start = poses[forbidden(poses)][:15]
    end = refine(info, merit, start, info.prior, feasible=forbidden)
    assert forbidden(end).all()
    assert merit.score(info.total(end)) > merit.score(info.total(start))
    apart = exchange(sample_pool(info, poses), merit, 15, info.prior, distance=0.4)
    moved = info.area.unit(refine(info, merit, poses[apart], info.prior, distance=0.4))
    assert (np.linalg.norm(moved[:, None] - moved[None], axis=2) + 10 * np.eye(15)).min() >= 0.4


def test_walk_back_ends_at_the_border(rng):
    start, end = np.zeros((5, 3)), rng.normal(size=(5, 3))
    inside = lambda q: np.linalg.norm(q, axis=1) <= 0.5  # noqa: E731
    back = walk_back(start, end, inside)
    length = np.linalg.norm(end, axis=1)
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), np.minimum(length, 0.5), rtol=0.1)
    assert inside(back).all()
