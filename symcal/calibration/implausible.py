"""Identified errors that are no errors of a robot: far beyond what is plausible."""

from __future__ import annotations

import numpy as np

from symcal.calibration.reasons import Reason
from symcal.parameters import Parameter
from symcal.robot.robot import Robot

IMPLAUSIBLE = 10.0
"""Plausible scales beyond which an error of a link or joint term is taken for a mistake: 10 mm, 0.1 rad by default."""


def implausible(robot: Robot) -> tuple[Reason, ...]:
    """Corrections of a calibrated robot that are implausibly large; none of a nominal one.

    Link parameters and joint terms are judged. The base says where the instrument stood, and nominal tools are often
    rough guesses: the sizes of their errors do not count. The limit is ours.
    """
    record = robot.record
    if record is None:
        return ()
    found = []
    for p in robot.described:
        error = record.errors.get(p.name, 0.0)
        if abs(error) > IMPLAUSIBLE * p.scale:
            limit = f"{IMPLAUSIBLE:g} times its plausible {_text(p, p.scale)}"
            text = f"{p.name} is off by {_text(p, error)}, more than {limit}"
            found.append(Reason("implausible", text, p.name))
    return tuple(found)


def _text(p: Parameter, value: float) -> str:
    if p.unit == "rad":
        return f"{np.degrees(value):.3g} deg"
    return f"{value:.3g}" if p.unit == "1" else f"{value:.3g} {p.unit}"
