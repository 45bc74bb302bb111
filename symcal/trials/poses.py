"""Poses of the working area at which every instrument can read, or that touch what is to be touched."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from symcal.model.contact import constraints, contact_postures
from symcal.model.model import Model
from symcal.planning.area import WorkingArea, draw
from symcal.planning.constraints import feasible
from symcal.planning.visibility import View, within_limits

Array = NDArray[np.float64]
PoseSource = Callable[[np.random.Generator, int], Array]
"""(generator, N) -> (N, dof)."""


def pose_source(model: Model, area: WorkingArea, view: View) -> PoseSource:
    """Uniform poses of the area; where instruments have limits, or postures must touch, those that do.

    The source raises RefusedError where hardly any pose will do.
    """
    limits = within_limits(model, view)
    seen = feasible(limits) if limits else None
    if constraints(model.measurement):
        bounds = (area.lower, area.upper)
        return lambda rng, count: contact_postures(model, count, lambda n: area.sample(rng, n), bounds, seen)
    if seen is None:
        return area.sample
    return lambda rng, count: draw(area, rng, count, seen)
