"""What a target must keep to be read, beyond what its instrument says: cameras see the printed side of plates only."""

from __future__ import annotations

import casadi as ca

from symcal.instruments import Margin
from symcal.model.observation import Observation

SX = ca.SX

FACING = Margin("turned towards the camera", "rad", 0.1)


def limits_of(observation: Observation) -> tuple[Margin, ...]:
    """What the features of an observation must keep to be read: the limits of its kind, and the target's side."""
    own = observation.instrument.limits
    return own if observation.faces is None else (*own, FACING)


def margins_of(observation: Observation, rotation: SX, point: SX, own: SX) -> SX:
    """Signed amounts, one per limit of `limits_of`, of a feature in the instrument's frame.

    The last is the largest incidence less the angle between the target's normal and the ray from the point to the
    camera: zero for a point that is looked at from straight ahead, above a right angle from behind.
    """
    margins = observation.instrument.margins(rotation, point, own)
    if observation.faces is None:
        return margins
    cosine = -ca.dot(rotation @ SX(observation.faces), point) / ca.norm_2(point)
    return ca.vertcat(margins, observation.target.largest_incidence - ca.acos(ca.fmax(-1, ca.fmin(1, cosine))))
