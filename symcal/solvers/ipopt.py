"""IPOPT with the Gauss-Newton Hessian J^T J: the interior-point witness of the other two.

Cost, gradient J^T r and Hessian J^T J come from the problem's own evaluation, in scaled unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import casadi as ca
import numpy as np

from symcal.solvers.least_squares import Array, Problem, Solution, Status, Tolerances, cost_of, iterate, stop_reason

_NO_TOLERANCES = Tolerances()

_ROUNDING = 1e-10  # of the cost

_STATUS = {
    "Solve_Succeeded": Status.GRADIENT,
    "Solved_To_Acceptable_Level": Status.COST,
    "Search_Direction_Becomes_Too_Small": Status.STALLED,
    "Feasible_Point_Found": Status.GRADIENT,
    "Maximum_Iterations_Exceeded": Status.ITERATIONS,
}


class _External(ca.Callback):
    """A NumPy function as CasADi wants it: named dense inputs and outputs."""

    def __init__(
        self,
        name: str,
        inputs: dict[str, ca.Sparsity],
        outputs: dict[str, ca.Sparsity],
        call: Callable[..., list[ca.DM]],
    ) -> None:
        ca.Callback.__init__(self)
        self.inputs, self.outputs, self.call_python = list(inputs.items()), list(outputs.items()), call
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.inputs)

    def get_n_out(self) -> int:
        return len(self.outputs)

    def get_name_in(self, i: int) -> str:
        return self.inputs[i][0]

    def get_name_out(self, i: int) -> str:
        return self.outputs[i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self.inputs[i][1]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self.outputs[i][1]

    def eval(self, arguments: Sequence[ca.DM]) -> Sequence[ca.DM]:
        return self.call_python(*arguments)


class _Visited:
    """The system at the point where IPOPT is, evaluated once for cost, gradient and Hessian."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.evaluations = 0
        self.at = np.full(problem.start.size, np.nan)
        self.residual, self.jacobian = np.zeros(0), np.zeros((0, 0))

    def __call__(self, y: ca.DM) -> tuple[Array, Array]:
        """Residual and scaled Jacobian."""
        point = np.asarray(y, dtype=float).ravel()
        if not np.array_equal(point, self.at):
            self.residual, jacobian = self.problem.evaluate(point * self.problem.scales)
            self.at, self.jacobian = point, jacobian * self.problem.scales
            self.evaluations += 1
        return self.residual, self.jacobian


def ipopt(problem: Problem, tolerances: Tolerances = _NO_TOLERANCES) -> Solution:
    """Minimise with IPOPT in scaled unknowns."""
    width = problem.scales
    points = [problem.start.astype(float)]
    visited = _Visited(problem)

    def finish(status: Status, detail: str) -> Solution:
        residuals = [problem.evaluate(point) for point in points]
        steps = [0.0, *(float(np.linalg.norm((b - a) / width)) for a, b in pairwise(points))]
        history = tuple(
            iterate(x, r, j, width, step, 0.0) for x, (r, j), step in zip(points, residuals, steps, strict=True)
        )
        r, j = residuals[-1]
        return Solution(points[-1], cost_of(r), r, j, status, detail, "ipopt", max(visited.evaluations, 1), history)

    residual, jacobian = problem.evaluate(points[0])
    if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
        return finish(Status.FAILED, "at the first guess")
    first = iterate(points[0], residual, jacobian, width, 0.0, 0.0)
    reason = stop_reason(first, first, problem.counted(residual), tolerances)
    if reason is not None:  # also the end of a problem without unknowns
        return finish(*reason)
    status = _run(problem, tolerances, visited, points)
    words = f"IPOPT: {status.replace('_', ' ').lower()}"
    found = _STATUS.get(status, Status.FAILED)
    if not found.converged and _settled(*problem.evaluate(points[-1])):
        found = Status.STALLED
    return finish(found, words)


def _settled(residual: Array, jacobian: Array) -> bool:
    """Would even the full Gauss-Newton step lower the cost by no more than rounding can tell?

    IPOPT's own test is on the gradient, which rounding keeps from its tolerance where costs are large.
    """
    step = np.linalg.lstsq(jacobian, -residual)[0]
    gain = 0.5 * float(np.sum((jacobian @ step) ** 2))
    return bool(np.isfinite(step).all()) and gain <= _ROUNDING * cost_of(residual)


def _run(problem: Problem, tolerances: Tolerances, visited: _Visited, points: list[Array]) -> str:
    """IPOPT's own word on how it ended; accepted points are appended."""
    width, n = problem.scales, problem.start.size
    column, square, none = ca.Sparsity.dense(n), ca.Sparsity.upper(n), ca.Sparsity(0, 0)
    scalar = ca.Sparsity.scalar()

    def cost(y: ca.DM) -> list[ca.DM]:
        return [ca.DM(cost_of(visited(y)[0]))]

    def slope(y: ca.DM, _: ca.DM) -> list[ca.DM]:
        r, j = visited(y)
        return [ca.DM(cost_of(r)), ca.DM(j.T @ r)]

    def curvature(y: ca.DM, _: ca.DM, weight: ca.DM, __: ca.DM) -> list[ca.DM]:
        j = visited(y)[1]
        return [ca.triu(ca.DM(float(weight) * (j.T @ j)))]

    costs: list[float] = []

    def accepted(y: ca.DM, *_: ca.DM) -> list[ca.DM]:
        x = np.asarray(y, dtype=float).ravel() * width
        if not np.array_equal(x, points[-1]):
            points.append(x)
        costs.append(cost_of(visited(y)[0]))
        done = len(costs) > 1 and 0 <= costs[-2] - costs[-1] <= tolerances.cost * costs[-2]
        return [ca.DM(int(done))]

    value = _External("cost", {"x": column}, {"f": scalar}, cost)
    gradient = _External("gradient", {"x": column, "p": none}, {"f": scalar, "grad_f_x": column}, slope)
    hessian = _External(
        "hessian",
        {"x": column, "p": none, "lam_f": scalar, "lam_g": none},
        {"triu_hess_gamma_x_x": square},
        curvature,
    )
    shapes = {"x": column, "f": scalar, "lam_x": column}
    follow = _External(
        "accepted",
        {ca.nlpsol_out(i): shapes.get(ca.nlpsol_out(i), none) for i in range(ca.nlpsol_n_out())},
        {"ok": scalar},
        accepted,
    )
    y = ca.MX.sym("y", n)
    solver = ca.nlpsol(
        "solver",
        "ipopt",
        {"x": y, "f": value(y)},
        {
            "print_time": False,
            "no_nlp_grad": True,
            "grad_f": gradient,
            "hess_lag": hessian,
            "iteration_callback": follow,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "tol": max(tolerances.gradient, 1e-12),
                "max_iter": tolerances.iterations,
                "acceptable_iter": 5,
                "acceptable_tol": max(1e-8, tolerances.gradient),
            },
        },
    )
    result = solver(x0=problem.start / width)
    accepted(result["x"])
    return str(solver.stats()["return_status"])
