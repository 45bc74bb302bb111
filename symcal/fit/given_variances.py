"""The estimate where noise and sizes are known: what is left of a fit when no variance is sought."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.fit.estimation import Options, variance_model
from symcal.fit.residual_rows import Rows
from symcal.fit.variances import VarianceModel, Variances
from symcal.solvers import SOLVERS
from symcal.solvers.least_squares import Problem

Array = NDArray[np.float64]

_ROUNDS = 60
_SETTLED = 1e-6  # change of a robust weight that ends the rounds


def estimate_given(
    rows: Rows, free: tuple[str, ...], options: Options, variances: Variances, start: Array, prior_mean: Array
) -> Array:
    """The errors of all parameters, shape (n,), that minimise the objective of a fit at given variances.

    With a robust loss the noise is kept, and the weights are found with the estimate.

    Args:
        variances: noise by group, factors on the sizes; weights to start from, shape (N, m). start: first guess, shape
            (n,).
    Raises:
        RefusedError: the minimisation does not converge.
    """
    model = variance_model(rows, free, options, prior_mean=prior_mean)
    model = replace(model, estimated=(), factors=(), hold=True)
    x = _minimised(model, options, variances, start)
    if model.loss == "linear":
        return x
    for _ in range(_ROUNDS):
        new = model.next(x, variances, _SETTLED)
        shift = float(np.abs(new.weights - variances.weights).max(initial=0.0))
        variances = new
        if shift < _SETTLED:
            break
        x = _minimised(model, options, variances, x)
    return x


def _minimised(model: VarianceModel, options: Options, variances: Variances, start: Array) -> Array:
    system, spread = model.system, model.spread(variances)

    def evaluate(y: Array) -> tuple[Array, Array]:
        stacked = system.rows_at(system.at(y), spread, variances.factors)
        return stacked[:, -1], stacked[:, :-1]

    problem = Problem(evaluate, system.scaled(start), np.ones(len(system.free)))
    solution = SOLVERS[options.solver](problem, options.tolerances)
    if not solution.status.converged:
        raise RefusedError(f"the fit of a half did not converge: {solution.message}")
    return system.at(solution.x)
