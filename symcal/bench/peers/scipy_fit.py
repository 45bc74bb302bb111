"""`scipy.optimize.least_squares`: one arm from its positions, as a user would write it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from symcal.bench.peers.fit_problem import FitProblem

Array = NDArray[np.float64]

Readings = Callable[[Array], Array]
"""x, shape (n,) -> positions, shape (N, 3)."""
Slopes = Callable[[Array], tuple[Array, Array]]
"""x -> positions, and slopes, shape (N, 3, n)."""


def fit_exact(problem: FitProblem, slopes: Slopes, method: Literal["lm", "trf"], tolerance: float = 1e-8) -> Array:
    """With exact slopes; positions and slopes come from one evaluation, which the Jacobian's call finds again."""
    last: list[tuple[Array, Array]] = []

    def residual(y: Array) -> Array:
        p, jacobian = slopes(problem.whole(y))
        last[:] = [(y.copy(), problem.slopes(jacobian))]
        return problem.rows(p, y)

    def jacobian(y: Array) -> Array:
        if not np.array_equal(last[0][0], y):
            residual(y)
        return last[0][1]

    return _fit(problem, residual, jacobian, method, tolerance)


def fit_differences(problem: FitProblem, readings: Readings, method: Literal["lm", "trf"]) -> Array:
    """With SciPy's own two-point differences."""
    return _fit(problem, lambda y: problem.rows(readings(problem.whole(y)), y), "2-point", method, 1e-8)


def _fit(
    problem: FitProblem,
    residual: Callable[[Array], Array],
    jacobian: Callable[[Array], Array] | Literal["2-point"],
    method: Literal["lm", "trf"],
    tolerance: float,
) -> Array:
    start = np.zeros(len(problem.free))
    found = least_squares(
        residual, start, jacobian, method=method, x_scale="jac", ftol=tolerance, xtol=tolerance, gtol=tolerance
    )
    return problem.whole(found.x)
