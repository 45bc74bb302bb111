"""Proven bounds against forty digits, dense samples, brute force, and maxima that a search is made to miss."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import casadi as ca
import mpmath as mp
import numpy as np
import proof_shapes
import pytest
from arms_with_terms import six_axis
from hypothesis import given, settings
from hypothesis import strategies as st
from planning_cases import fr3, handling
from proof_cases import arm, exact_trace, informed
from scipy.optimize import minimize

from symcal.errors import RefusedError
from symcal.joints.harmonics import Harmonics
from symcal.kernels.instructions import read_program
from symcal.planning.area import WorkingArea
from symcal.planning.certificate import certify
from symcal.planning.criteria import criterion
from symcal.planning.optimal_design import ApproximateDesign, optimal_design
from symcal.planning.plan_problem import plan_problem
from symcal.planning.proof import bernstein
from symcal.planning.proof.branch_and_bound import largest_value
from symcal.planning.proof.proof import SLACK
from symcal.planning.proof.running_error import evaluate
from symcal.planning.proof.trace_polynomial import Axis, TracePolynomial, apply, trace_polynomial
from symcal.planning.region import area_region, region_accuracy
from symcal.planning.search import select_poses
from symcal.planning.worst_pose import FeasibleSet, feasible_set
from symcal.runs.load import load

D = criterion("D")


def weight_of(info, rng, count=40):
    return np.linalg.inv(info.total(info.area.sample(rng, count)) / count)


def polynomial_of(info, rng):
    weight = weight_of(info, rng)
    return trace_polynomial(info.function, weight, info.area, info.measurement.chain.robot.joints, rng), weight


def drawn(rng, kinds, span=3.0) -> TracePolynomial:
    """A random polynomial of joints 'a' (angle), 'c' (whole circle) and 'l' (length)."""
    axes, lower, upper = [], [], []
    for i, kind in enumerate(kinds):
        low = rng.uniform(-2, 2)
        high = low + {"a": rng.uniform(0.3, span), "c": 2 * np.pi, "l": rng.uniform(1, 5)}[kind]
        pieces = max(math.ceil((high - low) / bernstein.WIDEST), 1) if kind != "l" else 1
        axes.append(Axis(i, kind != "l", 1.0, np.linspace(low, high, pieces + 1), kind != "c"))
        lower.append(low)
        upper.append(high)
    values = rng.normal(size=[len(axis.nodes) for axis in axes])
    return TracePolynomial(
        WorkingArea(np.array(lower), np.array(upper)), tuple(axes), values, np.zeros(values.shape), 0
    )


def brute_force(polynomial, per_axis=41):
    """The maximum by a dense grid and a polish of its best points."""
    area = polynomial.area
    grid = np.array(list(itertools.product(*np.linspace(area.lower, area.upper, per_axis).T)))
    values = polynomial(grid)
    best = grid[np.argsort(-values)[:20]]
    bounds = list(zip(area.lower, area.upper, strict=True))
    found = [minimize(lambda q: -polynomial(q[None])[0], pose, bounds=bounds, tol=1e-12) for pose in best]
    return max(values.max(), *(-each.fun for each in found))


@pytest.mark.parametrize("make", [handling, lambda: informed(arm(3, 4, ratio=-1.5, offset=0.3), "position", base=True)])
def test_nodes_and_their_error_bounds_hold_in_forty_digits(make, rng):
    """The witness differentiates a chain of elementary transforms by differences of 1e-20."""
    info = make()
    polynomial, weight = polynomial_of(info, rng)
    assert polynomial.errors.max() < 1e-10 * info.rank
    middle = 0.5 * (info.area.lower + info.area.upper)
    for which in np.transpose(np.unravel_index(rng.choice(polynomial.values.size, 8, False), polynomial.values.shape)):
        pose = middle.copy()
        for axis, k in zip(polynomial.axes, which, strict=True):
            pose[axis.joint] = axis.nodes[k]
        off = abs(exact_trace(info, pose, weight) - mp.mpf(float(polynomial.values[tuple(which)])))
        assert off <= polynomial.errors[tuple(which)]


def test_a_polynomial_is_the_trace_everywhere(rng):
    """Against rows that the kernel gives, at poses that took no part: signs, ratios, lengths, circles, held joints."""
    geared = arm(4, 7, limit=4.0, sign=-1, ratio=2.0, offset=0.7)
    area = WorkingArea(np.array([-1.0, 0.3, -2.0, -2.8]), np.array([1.0, 0.3, 2.0, 2.8]))
    held = informed(arm(4, 8), "pose", base=True, tool=True, area=area)
    for info in (handling(), informed(geared, "position", base=True), held, fr3()):
        polynomial, weight = polynomial_of(info, rng)
        poses = info.area.sample(rng, 300)
        rows = info.rows(poses)
        true = np.trace(rows @ weight @ rows.swapaxes(1, 2), axis1=1, axis2=2)
        np.testing.assert_allclose(polynomial(poses), true, rtol=0, atol=1e-9 * true.max())
    assert [axis.joint for axis in polynomial_of(handling(), rng)[0].axes] == [1, 2, 3, 4]  # base known: no waist


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_values_lie_between_the_coefficients_of_every_box(seed):
    """And are the coefficients at the corners; halving gives what a change of basis gives."""
    rng = np.random.default_rng(seed)
    polynomial = drawn(rng, rng.permutation(list("aal"))[: rng.integers(1, 4)])
    ends, coefficients = [], polynomial.values
    for i, axis in enumerate(polynomial.axes):
        coefficients = apply(axis.change(0), coefficients, i)
        low, high = axis.ends[:2]
        for level in range(rng.integers(0, 4)):
            middle = 0.5 * (low + high)
            half, up = axis.halving(level), rng.random() < 0.5
            assert half.min() >= 0
            assert np.abs(half.sum(axis=1) - 1).max() < 1e-14
            coefficients = apply(half[::-1, ::-1] if up else half, coefficients, i)
            low, high = (middle, high) if up else (low, middle)
        ends.append((low, high))
    low, high = np.transpose(ends)
    values = polynomial(low + (high - low) * rng.random((3000, len(low))))
    assert coefficients.min() - 1e-12 <= values.min()
    assert values.max() <= coefficients.max() + 1e-12
    corners = coefficients[tuple(slice(None, None, n - 1) for n in coefficients.shape)].ravel()
    np.testing.assert_allclose(polynomial(np.array(list(itertools.product(*ends)))), corners, atol=1e-11)


def test_coefficients_that_rise_are_of_a_function_that_rises(rng):
    for _ in range(200):
        low, width = rng.uniform(-3, 3), rng.uniform(0.1, 2.0)
        change = bernstein.from_angles(low, low + width)
        values = np.linalg.solve(change, np.cumsum(rng.exponential(size=5) ** 3))
        axis = Axis(0, True, 1.0, np.array([low, low + width]), True)
        assert (np.diff(axis.cardinal(np.linspace(low, low + width, 400)) @ values) > 0).all()


@pytest.mark.parametrize("kinds", ["a", "c", "l", "aa", "al", "ca", "cl", "cc", "aal", "cal"])
def test_bounds_are_the_known_maxima(kinds, rng):
    for _ in range(4):
        polynomial = drawn(rng, kinds, span=6.0)
        true = brute_force(polynomial)
        tight = largest_value(polynomial, true, 1e-5)
        assert tight.open_share == 0
        assert tight.value is None
        assert true - 1e-9 <= tight.upper <= true + 1e-5 + 1e-9


def test_a_planted_wrong_maximum_is_caught(rng):
    """Whatever too low maximum is claimed, the bound is of the true one and the pose is shown."""
    for kinds in ("aa", "ca", "aal"):
        polynomial = drawn(rng, kinds, span=6.0)
        true = brute_force(polynomial)
        for claimed in (true - 0.01, true - 1.0, -1e3):
            bound = largest_value(polynomial, claimed, 1e-3)
            assert bound.value is not None
            assert bound.pose is not None
            assert claimed < bound.value <= true + 1e-9
            assert true - 1e-9 <= bound.upper <= true + 1e-3 + 1e-9
            assert polynomial(bound.pose[None])[0] == pytest.approx(bound.value, abs=1e-9)


def test_little_work_leaves_a_share_open_and_the_bound_true(rng):
    polynomial = drawn(rng, "aal", span=6.0)
    true = brute_force(polynomial)
    for work in (0, 20_000, 200_000):
        bound = largest_value(polynomial, true, 1e-9, work=work)
        assert bound.upper >= true - 1e-9
        if work < 200_000:
            assert 0 < bound.open_share <= 1
    assert largest_value(polynomial, true, 1e-5).open_share == 0


def test_a_flat_polynomial_needs_no_joint(rng):
    polynomial = TracePolynomial(WorkingArea(np.zeros(2), np.ones(2)), (), np.array(3.0), np.array(1e-12), 0.0)
    bound = largest_value(polynomial, 3.0, 1e-6)
    assert bound.upper == pytest.approx(3.0, abs=1e-5)
    assert bound.open_share == 0
    np.testing.assert_array_equal(polynomial(rng.random((4, 2))), 3.0)


def test_errors_of_operations_hold_in_forty_digits(rng):
    """Cancellation and products, against the same formula in mpmath."""
    x, y = ca.SX.sym("q", 2), ca.SX(1e8)
    f = ca.sin(x[0]) * y - y * ca.sin(x[0] + 1e-9) + ca.cos(x[1]) ** 2 * x[1] - x[1]
    poses = rng.uniform(-3, 3, (20, 2))
    values, errors = evaluate(read_program(ca.Function("f", [x], [f])), poses)
    for pose, value, error in zip(poses, values[:, 0, 0], errors[:, 0, 0], strict=True):
        with mp.workdps(40):
            a, b, big = mp.mpf(float(pose[0])), mp.mpf(float(pose[1])), mp.mpf(10) ** 8
            exact = mp.sin(a) * big - big * mp.sin(a + mp.mpf(1e-9)) + mp.cos(b) ** 2 * b - b
            assert abs(exact - mp.mpf(float(value))) <= error < 1e-6
    with pytest.raises(RefusedError, match="no polynomial"):
        evaluate(read_program(ca.Function("g", [x], [ca.if_else(x[0] < 0, x[0], 2.0)])), poses)


def test_the_handling_robot_is_proven(rng):
    plan = select_poses(handling(), 40, rng, random=0, prove=True)
    proof = plan.certificate.proof
    assert proof is not None
    assert proof.complete
    assert proof.joints == 4
    assert 0.9995 <= proof.d_efficiency <= plan.certificate.d_efficiency_lower_bound
    assert 0.9995 <= proof.g_efficiency <= plan.certificate.g_efficiency
    assert "proven" in plan.certificate.statement
    # the search is the same without
    again = select_poses(handling(), 40, np.random.default_rng(20170829), random=0)
    assert again.certificate.proof is None
    assert "proven" not in again.certificate.statement


def test_no_design_is_above_the_ceiling(rng):
    """Random plans and the best of many exchanges stay below what is proven."""
    info = informed(arm(3, 2), "position", base=True)
    where = feasible_set(info.area, rng, 1000)
    proof = certify(info, where.sample[:40], D, where, rng, prove=True).proof
    assert proof is not None
    assert proof.complete
    best = optimal_design(info, D, where, info.prior / 40, where.sample, rng, tolerance=1e-4)
    assert D.value(best.matrix) <= proof.logdet_upper_bound <= D.value(best.matrix) + 5e-3 * info.rank
    for _ in range(20):
        assert D.value(info.total(info.area.snapped(rng, 40)) / 40) <= proof.logdet_upper_bound


def test_a_design_that_claims_too_much_is_mended(rng):
    """A design of a corner of the area, said to be optimal: the proof meets better poses and takes them in."""
    info = handling()
    area = info.area
    corner = WorkingArea(area.lower, area.lower + 0.4 * area.span)
    blind = FeasibleSet(corner.sample(rng, 2000), area)
    small = optimal_design(info, D, FeasibleSet(blind.sample, corner), info.prior / 40, blind.sample[:200], rng)
    claimed = ApproximateDesign(small.poses, small.weights, small.matrix, 0.0)
    plan = blind.sample[:40]
    made = certify(info, plan, D, blind, rng, designs=(claimed, claimed), prove=True)
    honest = certify(info, plan, D, feasible_set(area, rng, 3000), rng, tolerance=2e-4, prove=True)
    assert made.proof is not None
    assert honest.proof is not None
    assert made.proof.missed >= 1
    assert honest.proof.missed == 0
    assert made.proof.d_efficiency == pytest.approx(honest.proof.d_efficiency, rel=5e-3)
    claim = float(np.exp((D.value(info.total(plan) / 40) - D.value(small.matrix)) / info.rank))
    assert made.proof.d_efficiency < 0.9 * claim  # what the claim would have made of it
    assert made.logdet_upper_bound >= D.value(honest.design.matrix) - 1e-6


def test_constraints_loosen_and_never_break_a_proof(rng):
    info = handling()

    def low(poses):
        return poses[:, 1] < 1000

    where = feasible_set(info.area, rng, 2000, low)
    plan = where.sample[:40]
    made = certify(info, plan, D, where, rng, prove=True)
    assert made.proof is not None
    assert made.proof.d_efficiency < made.d_efficiency_lower_bound
    assert low(made.worst_pose[None]).all()
    assert D.value(made.design.matrix) <= made.proof.logdet_upper_bound


@pytest.mark.parametrize("name", ["A", "I", "O5", "O1"])
def test_other_criteria_with_a_bound_are_proven_too(name, rng):
    info = handling()
    accuracy = region_accuracy(info, area_region(info.area, rng, count=200))
    merit = criterion(name, poses=40, accuracy=accuracy)
    where = feasible_set(info.area, rng, 1500)
    plan = info.area.snapped(rng, 40)
    made = certify(info, plan, merit, where, rng, tolerance=0.01, prove=True)
    assert made.proof is not None
    assert made.proof.criterion_efficiency is not None
    assert made.proof.criterion_efficiency == pytest.approx(made.criterion_efficiency_lower_bound, rel=0.02)
    # no plan is better by more than that
    ratio = float(merit.value(info.total(plan)))
    best = float(merit.value(40 * made.own_design.matrix))
    reached = best / ratio if not merit.larger_is_better else ratio / best
    assert made.proof.criterion_efficiency <= reached + 1e-9


@pytest.mark.parametrize(
    "name",
    [
        "RPRPR craig, gears, noise by axis, two points",
        "4R, beyond whole circles, gears",
        "4R, within a degree",
        "6R, narrow, pose turned round, base and tool unknown",
        "4R, a prior",
    ],
)
def test_no_search_exceeds_a_bound(name, rng):
    """Rows of a kinematics that shares no code with the package, searches of scipy, designs by brute force."""
    found = proof_shapes.tried(proof_shapes.CASES[name](), rng, thorough=False)
    assert found.own == pytest.approx(found.value, rel=1e-9)
    assert 1 - 2 * SLACK < found.value <= 1
    assert found.bound.open_share == 0
    assert found.best <= found.ceiling


def test_joint_terms_are_not_proven(rng):
    """Columns of a second harmonic are of a higher degree; the same arm without them is of degree two."""
    terms = informed(replace(six_axis(), terms=(Harmonics(2, True, k=(2,)),)), "position")
    where = feasible_set(terms.area, rng, 500)
    made = certify(terms, where.sample[:60], D, where, rng, tolerance=0.5, prove=True)
    assert made.proof is None
    assert "more than degree two" in made.unproven
    assert "not proven" in made.statement
    assert polynomial_of(informed(six_axis(), "position"), rng)[0].departure < 1e-9


@pytest.mark.parametrize("name", ["tracker_and_wire", "vision"])
def test_distances_and_pixels_are_not_proven(name, configs, rng):
    experiment = load(configs / f"{name}.yaml")
    info = plan_problem(experiment.file, experiment.document, experiment.model, rng).info
    with pytest.raises(RefusedError, match="no polynomial"):
        trace_polynomial(info.function, np.eye(info.rank), info.area, info.measurement.chain.robot.joints, rng)


def test_a_finite_set_needs_no_proof(rng):
    info = handling()
    where = FeasibleSet(info.area.sample(rng, 200), None)
    made = certify(info, where.sample[:40], D, where, rng, prove=True)
    assert made.exhaustive
    assert made.proof is None
    assert made.unproven == ""
    assert "proven" not in made.statement
