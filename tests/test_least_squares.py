"""What the solvers share: the history's rows, the test for convergence, and the sentences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from symcal.solvers.least_squares import Iterate, Solution, Status, Tolerances, cost_of, iterate, stop_reason

RNG = np.random.default_rng(1)
A, B = RNG.normal(size=(7, 3)), RNG.normal(size=7)
SCALES = np.array([0.01, 1.0, 30.0])


def at(cost: float, gradient: float = 1.0, step: float = 1.0) -> Iterate:
    return Iterate(cost, gradient, step, 1.0, np.zeros(3))


def test_an_iterate_tells_the_largest_slope_of_the_cost_per_scale() -> None:
    x = np.array([0.3, -0.2, 0.1])
    row = iterate(x, A @ x - B, A, SCALES, 0.5, 2.0)
    slope = approx_fprime(np.zeros(3), lambda y: cost_of(A @ (x + SCALES * y) - B), 1e-7)
    assert row.cost == pytest.approx(0.5 * np.sum((A @ x - B) ** 2))
    assert row.gradient == pytest.approx(np.abs(slope).max(), rel=1e-5)
    assert (row.step, row.damping) == (0.5, 2.0)
    x[0] = 9.0
    assert row.x[0] == 0.3  # a copy: the history does not change with the estimate


def test_an_iterate_without_unknowns_has_no_gradient() -> None:
    assert iterate(np.zeros(0), B, np.zeros((7, 0)), np.zeros(0), 0.0, 0.0).gradient == 0.0


@pytest.mark.parametrize(
    ("previous", "current", "tolerances", "status"),
    [
        (at(4.0), at(2.0), Tolerances(), None),
        (at(4.0), at(2.0, gradient=1e-11), Tolerances(), Status.GRADIENT),
        (at(4.0), at(4.0 - 1e-9), Tolerances(cost=1e-8), Status.COST),
        (at(4.0), at(2.0, step=1e-13), Tolerances(), Status.STEP),
        (at(4.0), at(0.5 * 100 * 0.01**2), Tolerances(residual=0.011), Status.TARGET),
        (at(4.0), at(0.5 * 100 * 0.01**2), Tolerances(residual=0.009), None),
    ],
)
def test_each_reason_to_stop(
    previous: Iterate, current: Iterate, tolerances: Tolerances, status: Status | None
) -> None:
    reason = stop_reason(previous, current, 100, tolerances)
    assert (reason and reason[0]) == status
    assert reason is None or reason[1]  # with the number that decided


def test_the_start_can_be_the_minimum_but_cannot_have_stalled() -> None:
    start = at(4.0, step=0.0)
    assert stop_reason(start, start, 10, Tolerances()) is None
    start = at(4.0, gradient=0.0, step=0.0)
    assert stop_reason(start, start, 10, Tolerances()) == (Status.GRADIENT, "largest scaled gradient 0")


def test_every_status_is_a_sentence_that_says_whether_it_converged() -> None:
    for status in Status:
        assert status.converged == status.value.startswith("converged: ")
    assert {s for s in Status if not s.converged} == {Status.ITERATIONS, Status.FAILED}


def test_a_solution_counts_accepted_steps_and_tells_its_reason() -> None:
    rows = (at(3.0), at(2.0), at(1.0))
    found = Solution(np.zeros(3), 1.0, B, A, Status.STEP, "scaled step 1e-13", "some", 5, rows)
    assert found.iterations == 2
    assert found.message == "converged: the step is below the tolerance (scaled step 1e-13)"
