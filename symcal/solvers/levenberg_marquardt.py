"""Levenberg-Marquardt on the stacked system.

Each step minimises |J s + r|^2 + lambda |D s|^2, the least-squares solution of

    [ J               ]       [ -r ]
    [ sqrt(lambda) D  ] s  =  [  0 ]

which is [Ding2017] eq. 13 with D = I, without forming J^T J. With J D^-1 = U diag(w) V^T the solution for every lambda
is s = -D^-1 V diag(w / (w^2 + lambda)) U^T r, so one decomposition serves all trials of an iteration. D is fixed: the
identity or 1 / scales. Column norms of the current Jacobian (Marquardt, More) as D often lead the paper's problem to
its mirror root; they are not offered.
"""

from __future__ import annotations

import numpy as np

from symcal.least_squares import (
    Array,
    Problem,
    Solution,
    Status,
    Tolerances,
    cost_of,
    iterate,
    stop_reason,
)

_NO_TOLERANCES = Tolerances()


def levenberg_marquardt(
    problem: Problem,
    tolerances: Tolerances = _NO_TOLERANCES,
    *,
    damping: float = 1e-3,
    factor: float = 10.0,
    scaled: bool = True,
) -> Solution:
    """Minimise by damped steps; lambda is divided by ``factor`` after a success and multiplied by it after a failure.

    Args:
        damping: lambda of the first trial, in units of the squared whitened residual per squared scaled (or plain)
            unknown.
        scaled: D = 1 / scales; the identity when False (the paper).
    """
    width = problem.scales if scaled else np.ones_like(problem.scales)
    x = problem.start.astype(float)
    residual, jacobian = problem.evaluate(x)
    evaluations = 1
    history = [iterate(x, residual, jacobian, width, 0.0, damping)]

    def finish(status: Status, detail: str) -> Solution:
        return Solution(
            x, cost_of(residual), residual, jacobian, status, detail, "levenberg_marquardt", evaluations, tuple(history)
        )

    if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
        return finish(Status.FAILED, "at the first guess")
    reason = stop_reason(history[0], history[0], residual.size, tolerances)
    while reason is None:
        if len(history) > tolerances.iterations:
            return finish(Status.ITERATIONS, f"{tolerances.iterations}")
        w, v, projected = _decompose(jacobian * width, residual)
        while True:
            gain = _predicted_gain(w, projected, damping)
            if gain <= tolerances.cost * history[-1].cost:
                return finish(Status.COST, f"the best step would change it by {gain / (history[-1].cost or 1.0):.2g}")
            scaled_step = -v @ (w / (w**2 + damping) * projected)
            trial = x + width * scaled_step
            new_residual, new_jacobian = problem.evaluate(trial)
            evaluations += 1
            if cost_of(new_residual) < history[-1].cost and np.isfinite(new_jacobian).all():
                break
            length = float(np.linalg.norm(scaled_step))
            if length <= tolerances.step or damping > 1e12 * max(float(w[0]) ** 2, 1.0):
                return finish(Status.STALLED, f"scaled step {length:.2g}")
            damping *= factor
        x, residual, jacobian = trial, new_residual, new_jacobian
        history.append(iterate(x, residual, jacobian, width, float(np.linalg.norm(scaled_step)), damping))
        damping = max(damping / factor, 1e-20)
        reason = stop_reason(history[-2], history[-1], residual.size, tolerances)
    return finish(*reason)


def _predicted_gain(w: Array, projected: Array, damping: float) -> float:
    """Fall of the cost that the linear model promises for the damped step."""
    return 0.5 * float(np.sum(projected**2 * w**2 * (w**2 + 2 * damping) / (w**2 + damping) ** 2))


def _decompose(scaled: Array, residual: Array) -> tuple[Array, Array, Array]:
    """Singular values w, right vectors V as columns and U^T r; through a QR when there are more rows than columns."""
    if scaled.shape[0] > scaled.shape[1]:
        q, scaled = np.linalg.qr(scaled)
        residual = q.T @ residual
    u, w, vt = np.linalg.svd(scaled, full_matrices=False)
    return w, vt.T, u.T @ residual
