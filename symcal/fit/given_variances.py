"""The estimate where sizes of errors, and noise if it is wanted, are known from another fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.fit.estimation import ROUNDS, SETTLED, Options, minimised, variance_model
from symcal.fit.residual_rows import Rows
from symcal.fit.variances import VarianceModel, Variances

Array = NDArray[np.float64]


def estimate_given(
    rows: Rows,
    free: tuple[str, ...],
    options: Options,
    variances: Variances,
    start: Array,
    prior_mean: Array,
    *,
    noise_too: bool = False,
) -> tuple[VarianceModel, Array, Variances]:
    """The system, the errors of all parameters that minimise its objective, shape (n,), and its variances.

    With a robust loss the weights are found with the estimate.

    Args:
        variances: noise by group, factors on the sizes; weights to start from, shape (N, m). start: first guess, shape
            (n,). noise_too: unknown noise is found as in any fit, and the factors alone are given.
    Raises:
        RefusedError: the minimisation does not converge.
    """
    model = variance_model(rows, free, options, prior_mean=prior_mean)
    model = replace(model, factors=())
    if not noise_too:
        model = replace(model, estimated=(), hold=True)
    x = _minimised(model, options, variances, start)
    if model.settled:
        return model, x, variances
    for _ in range(ROUNDS):
        new = model.next(x, variances, SETTLED)
        shift = np.abs(new.weights - variances.weights).max(initial=0.0)
        change = max(float(shift), float(np.abs(model.difference(new, variances)).max(initial=0.0)))
        variances = new
        if change < SETTLED:
            break
        x = _minimised(model, options, variances, x)
    return model, x, variances


def _minimised(model: VarianceModel, options: Options, variances: Variances, start: Array) -> Array:
    solution = minimised(model, options, variances, start)
    if not solution.status.converged:
        raise RefusedError(f"the fit did not converge: {solution.message}")
    return model.system.at(solution.x)
