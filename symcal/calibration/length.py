"""How long the arm is, where nothing that is read sees lengths: what a fit says of one growth of all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symcal.fit.estimation import Fit
from symcal.model.growth import growth
from symcal.model.model import Model


@dataclass(frozen=True, slots=True)
class Length:
    """Growth of all lengths by one share, g - 1, and its standard deviation.

    size: its standard deviation by the plausible sizes of the lengths alone. known: whether known values, places or
    points tell something of it too.
    """

    growth: float
    sigma: float
    size: float
    known: bool


def unseen_length(model: Model, after: Fit) -> Length | None:
    """The growth that a fit holds by what is known alone; None where readings tell lengths."""
    measurement, parameters = model.measurement, model.parameters
    if measurement.sees_length:
        return None
    slope = measurement.growth[parameters.indices(after.free)]
    sigma = float(np.sqrt(slope @ after.posterior.covariance @ slope))
    size = float(np.linalg.norm(measurement.growth * parameters.scales))
    return Length(growth(measurement.growth, after.x) - 1, sigma, size, measurement.knows_length)
