"""How long the arm is, where nothing that is read sees lengths: what a fit says of one growth of all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symcal.fit.estimation import Fit
from symcal.model.growth import growth, growth_slope
from symcal.model.model import Model


@dataclass(frozen=True, slots=True)
class Length:
    """Growth of all lengths by one share, g - 1, and its standard deviation.

    known: whether known values between things tell something of it, beside the plausible sizes.
    """

    growth: float
    sigma: float
    known: bool


def unseen_length(model: Model, after: Fit) -> Length | None:
    """The growth that a fit holds by what is known alone; None where readings tell lengths."""
    if model.measurement.sees_length:
        return None
    parameters = model.parameters
    slope = growth_slope(parameters)[parameters.indices(after.free)]
    sigma = float(np.sqrt(slope @ after.posterior.covariance @ slope))
    return Length(growth(parameters, after.x) - 1, sigma, bool(model.measurement.known))
