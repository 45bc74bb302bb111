"""Postures that touch what must be touched, as a finite set to choose from.

A plan exchanges over it, and its certificate holds for it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError, RefusedError
from symcal.model.contact import constraints, contact_postures, projected, upright
from symcal.model.model import Model
from symcal.planning.area import Feasible, WorkingArea

Array = NDArray[np.float64]

_SNAPPED = 0.4  # of the coordinates that postures begin from: at a joint's limit, as informative ones are


def touching_pool(
    model: Model, area: WorkingArea, count: int, rng: np.random.Generator, feasible: Feasible | None
) -> Array:
    """Postures of the area projected onto the nominal constraints in turn, shape (count, dof); free ones among them
    where something else reads too.

    Raises:
        InputError: nobody says where a constraint roughly is. RefusedError: hardly any posture can touch one.
    """
    for part in constraints(model.measurement):
        o = part.observation
        if o.at.unknown and o.at.frame is None:
            message = "a plan needs to know roughly where this is: 'near: {xyz: [..]}'"
            raise InputError(message, key=f"measurements.{o.of}.at")
    share = iter([_SNAPPED, 0.0] * count)
    return contact_postures(
        model,
        count,
        lambda n: area.snapped(rng, n, next(share)),
        (area.lower, area.upper),
        feasible,
    )


def nearest_contacts(model: Model, poses: Array) -> Array:
    """Given postures, each moved onto the constraint that it is nearest to, shape (N, dof).

    Raises:
        RefusedError: a posture that can touch none.
    """
    x = np.zeros(len(model.parameters))
    best, distance = poses.copy(), np.full(len(poses), np.inf)
    for part in constraints(model.measurement):
        q, met = projected(model, part, poses, x, model.robot.lower, model.robot.upper)
        far = np.where(met & upright(model, part, q), np.linalg.norm(q - poses, axis=1), np.inf)
        nearer = far < distance
        best[nearer], distance[nearer] = q[nearer], far[nearer]
    if not np.isfinite(distance).all():
        lost = ", ".join(str(i + 1) for i in np.flatnonzero(~np.isfinite(distance))[:5])
        raise RefusedError(f"candidates that can touch nothing: {lost}")
    return best
