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

from collections.abc import Iterator, Sequence

import numpy as np

from symcal.solvers.appended import appended
from symcal.solvers.descent import Stop, Trial, descend
from symcal.solvers.least_squares import Array, Iterate, Problem, Solution, Status, Tolerances

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

    def propose(matrix: Array, residual: Array, history: Sequence[Iterate]) -> Iterator[Trial | Stop]:
        cost = history[-1].cost
        lam = damping if len(history) == 1 else max(history[-1].damping / factor, 1e-20)
        w, v, projected = _decompose(matrix, residual)
        while True:
            gain = _predicted_gain(w, projected, lam)
            if gain <= tolerances.cost * cost:
                yield Stop(Status.COST, f"the best step would change it by {gain / (cost or 1.0):.2g}")
            step = -v @ (w / (w**2 + lam) * projected)
            yield Trial(step, lam, float(np.nextafter(cost, -np.inf)))
            length = float(np.linalg.norm(step))
            if length <= tolerances.step or lam > 1e12 * max(float(w[0]) ** 2, 1.0):
                yield Stop(Status.STALLED, f"scaled step {length:.2g}")
            lam *= factor

    width = problem.scales if scaled else np.ones_like(problem.scales)
    return descend(problem, tolerances, propose, solver="levenberg_marquardt", width=width, first=damping)


def _predicted_gain(w: Array, projected: Array, damping: float) -> float:
    """Fall of the cost that the linear model promises for the damped step."""
    return 0.5 * float(np.sum(projected**2 * w**2 * (w**2 + 2 * damping) / (w**2 + damping) ** 2))


def _decompose(scaled: Array, residual: Array) -> tuple[Array, Array, Array]:
    """Singular values w, right vectors V as columns and U^T r; of the triangle of [J r] when there are more rows than
    columns: its last column is Q^T r, and Q is never formed."""
    rows, n = scaled.shape
    if rows > n:
        triangle = appended(np.zeros((0, n + 1)), np.column_stack([scaled, residual]))
        scaled, residual = triangle[:n, :n], triangle[:n, n]
    u, w, vt = np.linalg.svd(scaled, full_matrices=False)
    return w, vt.T, u.T @ residual
