"""Damped Gauss-Newton.

The minimum-norm solution of J s = -r in scaled unknowns by SVD, shortened until the cost falls (Armijo).
"""

from __future__ import annotations

import numpy as np

from symcal.least_squares import Problem, Solution, Status, Tolerances, cost_of, iterate, stop_reason

_NO_TOLERANCES = Tolerances()
_RANK = 1e-12  # singular values below this share of the largest are left out of a step
_ARMIJO = 1e-4
_SHORTEST = 1e-10


def gauss_newton(problem: Problem, tolerances: Tolerances = _NO_TOLERANCES) -> Solution:
    """Minimise by full Gauss-Newton steps, halved while they do not lower the cost enough."""
    width = problem.scales
    x = problem.start.astype(float)
    residual, jacobian = problem.evaluate(x)
    evaluations = 1
    history = [iterate(x, residual, jacobian, width, 0.0, 1.0)]

    def finish(status: Status, detail: str) -> Solution:
        return Solution(
            x, cost_of(residual), residual, jacobian, status, detail, "gauss_newton", evaluations, tuple(history)
        )

    if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
        return finish(Status.FAILED, "at the first guess")
    reason = stop_reason(history[0], history[0], residual.size, tolerances)
    while reason is None:
        if len(history) > tolerances.iterations:
            return finish(Status.ITERATIONS, f"{tolerances.iterations}")
        scaled = jacobian * width
        step = np.linalg.lstsq(scaled, -residual, rcond=_RANK)[0]
        slope = float(residual @ (scaled @ step))  # derivative of the cost along the step; negative
        if -slope / 2 <= tolerances.cost * history[-1].cost:
            return finish(Status.COST, f"the full step would change it by {-slope / 2 / (history[-1].cost or 1.0):.2g}")
        length = 1.0
        while True:
            trial = x + width * (length * step)
            new_residual, new_jacobian = problem.evaluate(trial)
            evaluations += 1
            enough = history[-1].cost + _ARMIJO * length * slope
            if cost_of(new_residual) <= enough and np.isfinite(new_jacobian).all():
                break
            length /= 2
            if length < _SHORTEST:
                return finish(Status.STALLED, f"scaled step {np.linalg.norm(step):.2g}")
        x, residual, jacobian = trial, new_residual, new_jacobian
        history.append(iterate(x, residual, jacobian, width, float(length * np.linalg.norm(step)), length))
        reason = stop_reason(history[-2], history[-1], residual.size, tolerances)
    return finish(*reason)
