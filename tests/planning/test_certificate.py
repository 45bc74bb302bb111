"""The certificate against convex optimisation by somebody else, complete sets, and a brute-force pool."""

from __future__ import annotations

import os

import numpy as np
import pytest
from planning_cases import fr3, handling

from symcal.planning.certificate import certify, smallest_variance
from symcal.planning.criteria import criterion
from symcal.planning.optimal_design import optimal_design, optimal_weights
from symcal.planning.region import area_region, region_accuracy
from symcal.planning.worst_pose import FeasibleSet, feasible_set

BRUTE_FORCE = int(os.environ.get("SYMCAL_BRUTE_FORCE", "50000"))


def whitened(matrices):
    """The same matrices in coordinates in which their mean is the identity: cone solvers like it."""
    values, vectors = np.linalg.eigh(matrices.mean(axis=0))
    root = vectors / np.sqrt(values)
    return root.T @ matrices @ root, root


def test_d_optimal_design_is_the_one_that_convex_optimisation_finds(rng):
    cp = pytest.importorskip("cvxpy")
    info = handling()
    where = FeasibleSet(info.area.snapped(rng, 60), None)
    merit = criterion("D")
    ours = optimal_design(info, merit, where, info.prior, where.sample, rng, tolerance=1e-4)
    matrices, root = whitened(info.matrices(where.sample))
    w = cp.Variable(60, nonneg=True)
    total = sum(w[k] * matrices[k] for k in range(60))
    problem = cp.Problem(cp.Maximize(cp.log_det(total)), [cp.sum(w) == 1])
    problem.solve(solver="CLARABEL")
    theirs = problem.value - 2 * np.linalg.slogdet(root)[1]
    assert float(merit.value(ours.matrix)) == pytest.approx(theirs, abs=2e-3)
    assert theirs <= float(merit.value(ours.matrix)) + info.rank * ours.excess + 1e-4


def test_weights_of_many_atoms_are_those_of_multiplication(rng):
    """Many atoms that are nearly the same, from weights far off; Titterington (1976) multiplies by the gains."""
    few = rng.normal(size=(30, 2, 8))
    rows = (few[:, None] + 0.01 * rng.normal(size=(30, 8, 2, 8))).reshape(-1, 2, 8)
    matrices = rows.swapaxes(1, 2) @ rows
    start = np.full(len(rows), 1e-9)
    start[-40:] = 1.0
    ground = np.zeros((8, 8))
    w = optimal_weights(criterion("D"), matrices, ground, start, 1e-3)
    gains = np.einsum("kij,ji->k", matrices, np.linalg.inv(np.einsum("k,kij->ij", w, matrices))) / 8
    theirs = np.full(len(rows), 1 / len(rows))
    for _ in range(2000):
        inverse = np.linalg.inv(np.einsum("k,kij->ij", theirs, matrices))
        theirs *= np.einsum("kij,ji->k", matrices, inverse) / 8
    values = [np.linalg.slogdet(np.einsum("k,kij->ij", each, matrices))[1] for each in (w, theirs)]
    assert gains.max() < 1 + 1e-3
    assert values[0] == pytest.approx(values[1], abs=8e-3)


@pytest.mark.parametrize("name", ["A", "I"])
def test_other_optimal_designs_are_those_of_convex_optimisation(name, rng):
    cp = pytest.importorskip("cvxpy")
    info = handling()
    accuracy = region_accuracy(info, area_region(info.area, rng, count=200))
    merit = criterion(name, accuracy=accuracy)
    where = FeasibleSet(info.area.snapped(rng, 50), None)
    ours = optimal_design(info, merit, where, info.prior, where.sample, rng, tolerance=1e-3)
    matrices, root = whitened(info.matrices(where.sample))
    weight = root.T @ (np.eye(info.rank) if name == "A" else accuracy.mean) @ root
    factor = np.linalg.cholesky(weight / np.trace(weight))
    w = cp.Variable(50, nonneg=True)
    total = sum(w[k] * matrices[k] for k in range(50))
    problem = cp.Problem(cp.Minimize(cp.matrix_frac(factor, total)), [cp.sum(w) == 1])
    problem.solve(solver="CLARABEL")
    theirs = problem.value * np.trace(weight)
    trace = float(np.exp(-merit.score(ours.matrix)))
    assert trace == pytest.approx(theirs, rel=2e-3)
    assert theirs >= trace / (1 + ours.excess) * (1 - 1e-4)


def test_weights_of_a_design_are_those_that_is_known(rng):
    """Rows along the axes and inside their simplex: equal weights on the axes are D-optimal ([Pukelsheim2006])."""
    from symcal.planning.optimal_design import optimal_weights

    rows = np.vstack([np.eye(4), rng.dirichlet(np.ones(4), size=10)])
    matrices = rows[:, :, None] * rows[:, None, :]
    weights = optimal_weights(criterion("D"), matrices, np.zeros((4, 4)), np.full(14, 1 / 14), 1e-6)
    np.testing.assert_allclose(weights[:4], 0.25, atol=1e-4)


def test_no_plan_beats_its_bound(rng):
    info = handling()
    where = feasible_set(info.area, rng, 3000)
    merit = criterion("D")
    for _ in range(3):
        plan = info.area.snapped(rng, 40, rng.random())
        proof = certify(info, plan, merit, where, rng)
        assert 0 < proof.d_efficiency_lower_bound <= 1
        assert 0 < proof.g_efficiency <= 1 + 1e-9
        assert proof.criterion_efficiency_lower_bound == proof.d_efficiency_lower_bound
        # the bound belongs to the set, not to the plan
        assert proof.logdet_upper_bound == pytest.approx(
            certify(info, info.area.sample(rng, 25), merit, where, rng).logdet_upper_bound, abs=0.03
        )


@pytest.mark.parametrize("make", [handling, fr3])
def test_brute_force_finds_no_pose_that_violates_the_certificate(make, rng):
    """A plain sample knows nothing of limits and polish; no pose of it may exceed the searched maxima."""
    info = make()
    where = feasible_set(info.area, rng, 3000)
    plan = info.area.snapped(rng, 40)
    proof = certify(info, plan, criterion("D"), where, rng, tolerance=0.01)
    slope = np.linalg.inv(proof.design.matrix)
    of_plan = np.linalg.inv(info.total(plan) / 40)
    largest_design = largest_plan = 0.0
    for _ in range(max(BRUTE_FORCE // 50_000, 1)):
        for share in (0.0, 0.4):
            poses = info.area.snapped(rng, min(BRUTE_FORCE, 50_000) // 2, share)
            largest_design = max(largest_design, info.function.weighted(poses, slope).max())
            largest_plan = max(largest_plan, info.function.weighted(poses, of_plan).max())
    assert largest_design <= info.rank + proof.gap + 1e-6
    assert info.rank / largest_plan >= proof.g_efficiency * (1 - 1e-9)


def test_other_criteria_are_bounded_or_said_not_to_be(rng):
    info = handling()
    accuracy = region_accuracy(info, area_region(info.area, rng, count=200))
    where = feasible_set(info.area, rng, 1500)
    plan = info.area.snapped(rng, 40)
    for name in ("A", "I", "O1", "O5"):
        bound = certify(info, plan, criterion(name, poses=40, accuracy=accuracy), where, rng, tolerance=0.02)
        assert 0 < bound.criterion_efficiency_lower_bound < 1
    for name in ("E", "cond", "O4", "G"):
        none = certify(info, plan, criterion(name, accuracy=accuracy), where, rng, tolerance=0.05)
        assert none.criterion_efficiency_lower_bound is None
        assert "none known" in none.statement


def test_smallest_variance_is_below_every_plan_and_tight_at_the_optimum(rng):
    info = handling()
    accuracy = region_accuracy(info, area_region(info.area, rng, count=200))
    where = feasible_set(info.area, rng, 2000)
    merit = criterion("I", accuracy=accuracy)
    design = optimal_design(info, merit, where, info.prior, where.sample[:100], rng)
    bound = smallest_variance(info, accuracy.mean, design.matrix, np.zeros_like(info.prior), where, rng)
    assert np.exp(-merit.score(design.matrix)) == pytest.approx(bound, rel=5e-3)
    for _ in range(20):
        plan = info.area.snapped(rng, 40, rng.random())
        assert float(merit.value(info.total(plan))) ** 2 * 40 >= bound


def test_candidates_are_searched_completely(rng):
    info = handling()
    where = FeasibleSet(info.area.sample(rng, 200), None)
    proof = certify(info, where.sample[:40], criterion("D"), where, rng)
    assert proof.exhaustive
    assert "all 200 poses to choose from" in proof.statement
    slope = np.linalg.inv(proof.design.matrix)
    assert proof.gap == pytest.approx(max(info.function.weighted(where.sample, slope).max() - info.rank, 0.0), abs=1e-6)


def test_bound_of_a_seven_axis_arm_is_the_one_that_convex_optimisation_finds(rng):
    cp = pytest.importorskip("cvxpy")
    info, count = fr3(), 120
    where = FeasibleSet(info.area.snapped(rng, count), None)
    proof = certify(info, where.sample[:20], criterion("D"), where, rng, tolerance=1e-4)
    matrices, root = whitened(info.matrices(where.sample))
    w = cp.Variable(count, nonneg=True)
    total = sum(w[k] * matrices[k] for k in range(count))
    problem = cp.Problem(cp.Maximize(cp.log_det(total)), [cp.sum(w) == 1])
    problem.solve(solver="CLARABEL")
    theirs = problem.value - 2 * np.linalg.slogdet(root)[1]
    # never below the optimum, and above it by no more than its own slack
    assert theirs - 1e-4 <= proof.logdet_upper_bound <= theirs + info.rank * 1e-4 + 1e-3
    of_plan = np.linalg.slogdet(info.total(where.sample[:20]) / 20)[1]
    assert proof.d_efficiency_lower_bound == pytest.approx(np.exp((of_plan - theirs) / info.rank), rel=1e-3)
