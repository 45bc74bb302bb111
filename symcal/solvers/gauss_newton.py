"""Damped Gauss-Newton.

The minimum-norm solution of J s = -r in scaled unknowns by SVD, shortened until the cost falls (Armijo).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from symcal.solvers.descent import Stop, Trial, descend
from symcal.solvers.least_squares import Array, Iterate, Problem, Solution, Status, Tolerances

_NO_TOLERANCES = Tolerances()
_RANK = 1e-12  # singular values below this share of the largest are left out of a step
_ARMIJO = 1e-4
_SHORTEST = 1e-10


def gauss_newton(problem: Problem, tolerances: Tolerances = _NO_TOLERANCES) -> Solution:
    """Minimise by full Gauss-Newton steps, halved while they do not lower the cost enough."""

    def propose(scaled: Array, residual: Array, history: Sequence[Iterate]) -> Iterator[Trial | Stop]:
        cost = history[-1].cost
        step: Array = np.asarray(np.linalg.lstsq(scaled, -residual, rcond=_RANK)[0], dtype=np.float64)
        slope = float(residual @ (scaled @ step))  # derivative of the cost along the step; negative
        if -slope / 2 <= tolerances.cost * cost:
            yield Stop(Status.COST, f"the full step would change it by {-slope / 2 / (cost or 1.0):.2g}")
        length = 1.0
        while length >= _SHORTEST:
            yield Trial(length * step, length, cost + _ARMIJO * length * slope)
            length /= 2
        yield Stop(Status.STALLED, f"scaled step {np.linalg.norm(step):.2g}")

    return descend(problem, tolerances, propose, solver="gauss_newton", width=problem.scales, first=1.0)
