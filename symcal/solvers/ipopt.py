"""IPOPT with the Gauss-Newton Hessian J^T J of the symbolic residual: the interior-point witness of the other two."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from symcal.least_squares import Problem, Solution, Status, Tolerances, cost_of, iterate

_NO_TOLERANCES = Tolerances()

_STATUS = {
    "Solve_Succeeded": Status.GRADIENT,
    "Solved_To_Acceptable_Level": Status.COST,
    "Search_Direction_Becomes_Too_Small": Status.STALLED,
    "Feasible_Point_Found": Status.GRADIENT,
    "Maximum_Iterations_Exceeded": Status.ITERATIONS,
}


class _Iterates(ca.Callback):
    """Records the unknowns after every step that IPOPT accepts."""

    def __init__(self, unknowns: int) -> None:
        ca.Callback.__init__(self)
        self.unknowns = unknowns
        self.points: list[np.ndarray] = []
        self.construct("iterates", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        name = ca.nlpsol_out(i)
        return (
            ca.Sparsity.dense(self.unknowns)
            if name in ("x", "lam_x")
            else ca.Sparsity.scalar()
            if name == "f"
            else ca.Sparsity(0, 0)
        )

    def eval(self, arguments: Sequence[ca.DM]) -> Sequence[ca.DM]:
        self.points.append(np.asarray(arguments[0]).ravel())
        return [ca.DM(0)]


def ipopt(problem: Problem, tolerances: Tolerances = _NO_TOLERANCES) -> Solution:
    """Minimise with IPOPT in scaled unknowns.

    Raises:
        ValueError: the problem carries no symbolic function.
    """
    if problem.function is None:
        raise ValueError("IPOPT needs Problem.function")
    width = problem.scales
    n = problem.start.size
    y = ca.MX.sym("y", n)
    residual = problem.function()(y * width)
    jacobian = ca.jacobian(residual, y)
    weight, multipliers = ca.MX.sym("weight"), ca.MX.sym("multipliers", 0)
    hessian = ca.Function(
        "hessian",
        [y, ca.MX.sym("p", 0), weight, multipliers],
        [ca.triu(weight * (jacobian.T @ jacobian))],
        ["x", "p", "lam_f", "lam_g"],
        ["triu_hess_gamma_x_x"],
    )
    seen = _Iterates(n)
    solver = ca.nlpsol(
        "ipopt",
        "ipopt",
        {"x": y, "f": 0.5 * ca.dot(residual, residual)},
        {
            "print_time": False,
            "hess_lag": hessian,
            "iteration_callback": seen,
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
    stats = solver.stats()
    x = np.asarray(result["x"]).ravel() * width
    points = [p * width for p in seen.points] or [problem.start.astype(float), x]
    history = []
    previous = points[0]
    for point in points:
        r, j = problem.evaluate(point)
        history.append(iterate(point, r, j, width, float(np.linalg.norm((point - previous) / width)), 0.0))
        previous = point
    final_residual, final_jacobian = problem.evaluate(x)
    return Solution(
        x,
        cost_of(final_residual),
        final_residual,
        final_jacobian,
        _STATUS.get(stats["return_status"], Status.FAILED),
        f"IPOPT: {stats['return_status'].replace('_', ' ').lower()}",
        "ipopt",
        int(stats.get("n_call_nlp_f", len(points))),
        tuple(history),
    )
