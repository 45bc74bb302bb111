"""Solver x problem matrix against SciPy, and what is particular to each solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from cases import TABLE_III, front_half, handling_model
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from symcal.calibration.simulate import simulate
from symcal.instruments.noise import Noise
from symcal.solvers import SOLVERS, gauss_newton, ipopt, levenberg_marquardt
from symcal.solvers.least_squares import Array, Problem, Solution, Status, Tolerances

Residual = Callable[[Array], Array]


@dataclass(frozen=True)
class Case:
    """A residual whose Jacobian is taken by complex steps: exact to rounding, and not written by hand."""

    name: str
    residual: Residual
    start: Array
    scales: Array
    full_rank: bool = True

    def jacobian(self, x: Array) -> Array:
        step = 1e-30
        columns = [self.residual(x + 1j * step * e).imag / step for e in np.eye(x.size)]
        return np.array(columns).T

    @property
    def problem(self) -> Problem:
        return Problem(lambda x: (self.residual(x), self.jacobian(x)), self.start, self.scales)


def rosenbrock(x: Array) -> Array:
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])


def powell(x: Array) -> Array:
    """Powell's singular function: rank two of four at its minimum."""
    return np.array(
        [x[0] + 10 * x[1], np.sqrt(5) * (x[2] - x[3]), (x[1] - 2 * x[2]) ** 2, np.sqrt(10) * (x[0] - x[3]) ** 2]
    )


def decay(rng: np.random.Generator) -> Residual:
    t = np.linspace(0, 4, 60)
    data = 2.5 * np.exp(-1.3 * t) + 0.4 + 0.02 * rng.normal(size=t.size)
    return lambda x: x[0] * np.exp(-x[1] * t) + x[2] - data


def line(rng: np.random.Generator) -> Residual:
    a, b = rng.normal(size=(30, 5)), rng.normal(size=30)
    return lambda x: a @ x - b


def sum_only(rng: np.random.Generator) -> Residual:
    t = rng.normal(size=25)
    data = np.exp(0.7 * t) + 0.01 * rng.normal(size=25)
    return lambda x: np.exp((x[0] + x[1]) * t) - data


def bundle(rng: np.random.Generator) -> Residual:
    """Three views with unknown poses of ten unknown points; the first camera and the scale are held."""
    points = rng.uniform([-1, -1, 5], [1, 1, 7], (10, 3))
    poses = np.vstack([rng.normal(scale=0.05, size=(2, 3)), [[0.5, 0, 0], [0, 0.5, 0]]]).reshape(2, 2, 3)

    def project(p: Array, turn: Array, shift: Array) -> Array:
        k = np.array(
            [[0 * turn[0], -turn[2], turn[1]], [turn[2], 0 * turn[0], -turn[0]], [-turn[1], turn[0], 0 * turn[0]]]
        )
        rotation = np.linalg.solve(np.eye(3) - k / 2, np.eye(3) + k / 2)  # Cayley: analytic, for the complex step
        seen = p @ rotation.T + shift
        return seen[:, :2] / seen[:, 2:]

    def views(x: Array) -> Array:
        p = np.concatenate([x[:29], [points[9, 2]]]).reshape(10, 3)
        still = np.zeros(3)
        return np.concatenate(
            [project(p, still, still), project(p, x[29:32], x[32:35]), project(p, x[35:38], x[38:41])]
        ).ravel()

    truth = np.concatenate([points.ravel()[:29], poses[0, 0], poses[1, 0], poses[0, 1], poses[1, 1]])
    data = views(truth) + 1e-4 * rng.normal(size=60)
    return lambda x: 1e3 * (views(x) - data)


def cases() -> list[Case]:
    rng = np.random.default_rng(11)
    points = np.random.default_rng(11)
    start = np.concatenate([points.uniform([-1, -1, 5], [1, 1, 7], (10, 3)).ravel()[:29], np.zeros(12)])
    start[:29] += 0.05 * points.normal(size=29)
    start[[32, 39]] = 0.4
    return [
        Case("rosenbrock", rosenbrock, np.array([-1.2, 1.0]), np.ones(2)),
        Case("line", line(rng), np.zeros(5), np.array([1.0, 0.1, 1.0, 10.0, 1.0])),
        Case("decay", decay(rng), np.array([1.0, 0.5, 0.0]), np.array([1.0, 0.1, 0.5])),
        Case("bundle", bundle(np.random.default_rng(11)), start, np.ones(41)),
        Case("sum only", sum_only(rng), np.array([0.1, 0.1]), np.ones(2), full_rank=False),
        Case("powell", powell, np.array([3.0, -1.0, 0.0, 1.0]), np.ones(4), full_rank=False),
    ]


CASES = cases()
every_case = pytest.mark.parametrize("case", CASES, ids=lambda c: c.name)
every_solver = pytest.mark.parametrize("name", SOLVERS)


def solve(name: str, case: Case, tolerances: Tolerances = Tolerances()) -> Solution:
    return SOLVERS[name](case.problem, tolerances)  # type: ignore[index]


@every_case
@every_solver
def test_the_minimum_is_scipys(name: str, case: Case) -> None:
    found = solve(name, case)
    witness = least_squares(
        case.residual, case.start, case.jacobian, method="trf", x_scale=case.scales, ftol=1e-15, xtol=1e-15, gtol=1e-15
    )
    assert found.status.converged
    assert found.cost == pytest.approx(witness.cost, rel=1e-9, abs=1e-12)
    if case.full_rank:
        assert np.abs((found.x - witness.x) / case.scales).max() < 1e-6


@pytest.mark.parametrize("case", [c for c in CASES if c.full_rank], ids=lambda c: c.name)
def test_the_solvers_agree(case: Case) -> None:
    tight = Tolerances(gradient=1e-11, cost=1e-18)  # each approaches the minimum linearly, from its own side
    x = [solve(name, case, tight).x / case.scales for name in SOLVERS]
    for other in x[1:]:
        assert np.allclose(other, x[0], rtol=1e-8, atol=1e-8)


@every_case
@every_solver
def test_a_solution_tells_the_truth_about_itself(name: str, case: Case) -> None:
    found = solve(name, case)
    assert found.solver == name
    assert np.allclose(found.residual, case.residual(found.x), rtol=1e-12, atol=1e-12)
    assert np.allclose(found.jacobian, case.jacobian(found.x), rtol=1e-9, atol=1e-9)
    assert found.cost == pytest.approx(0.5 * np.sum(found.residual**2))
    assert found.evaluations >= len(found.history) - 1
    first, last = found.history[0], found.history[-1]
    assert np.array_equal(first.x, case.start)
    assert first.step == 0
    assert first.cost == pytest.approx(0.5 * np.sum(case.residual(case.start) ** 2))
    assert np.array_equal(last.x, found.x)
    for before, after in pairwise(found.history):
        assert after.step == pytest.approx(np.linalg.norm((after.x - before.x) / case.scales), rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("name", ["levenberg_marquardt", "gauss_newton"])
@every_case
def test_no_accepted_step_raises_the_cost(name: str, case: Case) -> None:
    costs = [row.cost for row in solve(name, case).history]
    assert all(after < before for before, after in pairwise(costs))


@every_solver
def test_the_number_of_iterations_is_limited_and_said(name: str) -> None:
    found = solve(name, CASES[0], Tolerances(iterations=3))
    assert found.status is Status.ITERATIONS
    assert found.iterations == 3
    assert found.message.startswith("stopped: the largest number of iterations was reached before convergence")


@every_solver
def test_nothing_to_find_is_found_at_once(name: str) -> None:
    empty = Problem(lambda _: (np.ones(4), np.zeros((4, 0))), np.zeros(0), np.zeros(0))
    found = SOLVERS[name](empty, Tolerances())  # type: ignore[index]
    assert found.status is Status.GRADIENT
    assert (found.iterations, found.cost, found.x.shape) == (0, 2.0, (0,))


@every_solver
def test_a_start_at_the_minimum_stays(name: str) -> None:
    case = replace(CASES[1], start=solve("gauss_newton", CASES[1]).x)
    found = solve(name, case)
    assert found.status.converged
    assert np.abs(found.x - case.start).max() < 1e-12


@every_solver
def test_a_model_without_a_number_fails_in_words(name: str) -> None:
    nowhere = Problem(lambda _: (np.full(3, np.nan), np.eye(3)), np.zeros(3), np.ones(3))
    found = SOLVERS[name](nowhere, Tolerances())  # type: ignore[index]
    assert found.message == "failed: the model gave no finite number (at the first guess)"


@pytest.mark.parametrize("name", ["levenberg_marquardt", "gauss_newton"])
def test_a_step_into_nowhere_is_shortened(name: str) -> None:
    def evaluate(x: Array) -> tuple[Array, Array]:  # log(x) - 1 has no value at and below zero
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.log(x) - 1, np.diag(1 / x)

    found = SOLVERS[name](Problem(evaluate, np.array([20.0]), np.ones(1)), Tolerances())  # type: ignore[index]
    assert found.x[0] == pytest.approx(np.e)


@pytest.mark.parametrize("name", ["levenberg_marquardt", "gauss_newton"])
def test_the_target_residual_stops_early(name: str) -> None:
    found = solve(name, CASES[0], Tolerances(residual=0.5))
    assert found.status is Status.TARGET
    assert np.sqrt(np.mean(found.residual**2)) < 0.5


@pytest.mark.parametrize("scaled", [True, False])
@pytest.mark.parametrize("damping", [1e-6, 1e-1, 1e3])
def test_a_levenberg_marquardt_step_solves_the_stacked_system(scaled: bool, damping: float) -> None:
    case = replace(CASES[2], start=np.array([2.0, 1.0, 0.3]))
    found = levenberg_marquardt(case.problem, Tolerances(iterations=1), damping=damping, scaled=scaled)
    used = found.history[1].damping
    d = np.diag(1 / case.scales) if scaled else np.eye(3)
    stacked = np.vstack([case.jacobian(case.start), np.sqrt(used) * d])
    q, r = np.linalg.qr(stacked)
    step = np.linalg.solve(r, q.T @ np.concatenate([-case.residual(case.start), np.zeros(3)]))
    assert np.allclose(found.x - case.start, step, rtol=1e-9, atol=1e-15)


def test_damping_falls_tenfold_after_a_success() -> None:
    history = levenberg_marquardt(CASES[1].problem, damping=1.0).history
    assert history[0].damping == history[1].damping == 1.0
    assert history[2].damping == pytest.approx(0.1)


def test_gauss_newton_takes_the_shortest_of_many_steps() -> None:
    case = next(c for c in CASES if c.name == "sum only")
    found = gauss_newton(case.problem)
    assert found.x[0] == pytest.approx(found.x[1], abs=1e-12)  # the difference, which nothing sees, stays zero


def test_small_residual_differences_do_not_lose_digits() -> None:
    """Condition number 1e9: normal equations would keep no digit of the worst direction."""
    rng = np.random.default_rng(3)
    u, _ = np.linalg.qr(rng.normal(size=(40, 6)))
    v, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    a = u @ np.diag(np.logspace(0, -9, 6)) @ v.T
    truth = rng.normal(size=6)
    problem = Problem(lambda x: (a @ (x - truth), a), np.zeros(6), np.ones(6))
    tight = Tolerances(gradient=1e-30, cost=0.0, step=0.0)
    assert np.abs(levenberg_marquardt(problem, tight, damping=1e-24).x - truth).max() < 1e-5
    assert np.abs(gauss_newton(problem, tight).x - truth).max() < 1e-5


def test_the_papers_simulation_finds_the_true_root_with_unit_damping() -> None:
    """[Ding2017] Simulation I: noise-free positions, all fifteen errors start at 0.01, lambda_0 = 1, D = I."""
    model = handling_model()
    truth = model.parameters.vector(TABLE_III)
    rng = np.random.default_rng(4)
    for _ in range(5):
        q = front_half(40, rng)
        z = simulate(model, TABLE_III, q, Noise(), rng).z

        def evaluate(x: Array, q: Array = q, z: Array = z) -> tuple[Array, Array]:
            r, j = model.residual(q, x, model.setup.vector, z)
            return r.ravel(), j.reshape(-1, 15)

        problem = Problem(evaluate, np.full(15, 0.01), model.parameters.scales)
        found = levenberg_marquardt(problem, Tolerances(residual=1e-12), damping=1.0, scaled=False)
        assert found.status.converged
        assert np.abs(found.x - truth).max() < 1e-5
        assert 8 <= found.iterations <= 14


def test_ipopt_follows_turns_as_the_others_do(rng: np.random.Generator) -> None:
    """A rotation vector fitted to turned points: a problem of robots rather than of textbooks."""
    points = rng.normal(size=(20, 3))
    seen = Rotation.from_rotvec([0.4, -0.2, 0.7]).apply(points) + 1e-3 * rng.normal(size=(20, 3))

    def evaluate(x: Array) -> tuple[Array, Array]:
        turned = Rotation.from_rotvec(x).apply(points)
        e = 1e-6
        j = np.array(
            [
                (Rotation.from_rotvec(x + e * k).apply(points) - Rotation.from_rotvec(x - e * k).apply(points))
                for k in np.eye(3)
            ]
        )
        return (turned - seen).ravel(), (j / (2 * e)).reshape(3, -1).T

    problem = Problem(evaluate, np.zeros(3), np.full(3, 0.1))
    assert np.abs(ipopt(problem).x - gauss_newton(problem).x).max() < 1e-8
