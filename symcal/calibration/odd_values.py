"""Known values that do not go with what was measured.

With r the residual of a value over its noise and h its share of the hat matrix, J C J^T, the value is off what all else
says of it by r / sqrt(1 - h) standard deviations: the residual of leaving it out ([Cook1982]).
"""

from __future__ import annotations

import numpy as np

from symcal.fit.estimation import Fit
from symcal.model.model import Model

_DOUBTFUL = 3.5  # standard deviations
_LEAST_LEFT = 1e-4


def odd_values(model: Model, after: Fit) -> list[str]:
    """Which known values contradict the measurements, each with by how much."""
    index = model.parameters.indices(after.free)
    untold = set(model.placement) - set(after.free)
    found = []
    for o, r, jacobian in model.measurement.known_rows(after.x, after.setup):
        if not untold.isdisjoint(o.names):
            continue
        hat = np.einsum("ij,jk,ik->i", jacobian[:, index], after.posterior.covariance, jacobian[:, index])
        off = float(np.max(np.abs(r) / np.sqrt(np.maximum(1 - hat, _LEAST_LEFT))))
        if off > _DOUBTFUL:
            found.append(
                f"what is known of '{o.name}' is {off:.3g} standard deviations off what was measured: is the value "
                "right, is its noise, and is it between these two? A wrong one bends all that is identified"
            )
    return found
