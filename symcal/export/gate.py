"""What must not reach a controller without being asked for twice.

A fit always returns numbers. Two kinds of them are no corrections of a robot: those of a fit that did not converge, and
errors far beyond what is plausible. What the data did not tell stays near nominal and does no harm. The limit is ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from symcal.errors import RefusedError
from symcal.parameters import Parameter
from symcal.robot.robot import Robot

IMPLAUSIBLE = 10.0
"""Plausible scales beyond which an error of a link or joint term is taken for a mistake: 10 mm, 0.1 rad by default."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why one number should not be exported, or all of them: parameter is then empty."""

    parameter: str
    reason: Literal["implausible", "unsettled", "remainder"]
    text: str


def doubts(robot: Robot) -> tuple[Doubt, ...]:
    """What speaks against using a calibration on a controller; empty for a nominal robot.

    Link parameters and joint terms are judged. The base says where the instrument stood, and nominal tools are often
    rough guesses: the sizes of their errors do not count.
    """
    record = robot.record
    if record is None:
        return ()
    found: list[Doubt] = []
    if record.provenance.get("trouble"):
        found.append(Doubt("", "unsettled", f"the identification did not converge: {record.provenance['trouble']}"))
    for p in robot.described:
        error = record.errors.get(p.name, 0.0)
        if abs(error) > IMPLAUSIBLE * p.scale:
            limit = f"{IMPLAUSIBLE:g} times its plausible {_text(p, p.scale)}"
            found.append(Doubt(p.name, "implausible", f"{p.name} is off by {_text(p, error)}, more than {limit}"))
    return tuple(found)


def check_exportable(robot: Robot, force: bool = False) -> tuple[Doubt, ...]:
    """Let a calibration pass to a controller, or refuse it by name and reason.

    Returns:
        the doubts that ``force`` overrode.
    Raises:
        RefusedError: there are doubts and ``force`` is False.
    """
    found = doubts(robot)
    if found and not force:
        reasons = "; ".join(doubt.text for doubt in found)
        raise RefusedError(
            f"this calibration of {robot.name} should not go to a controller: {reasons}. Look for the mistake in the "
            "measurements or the robot file, hold parameters at nominal, state their true scales, or force the export"
        )
    return found


def _text(p: Parameter, value: float) -> str:
    if p.unit == "rad":
        return f"{np.degrees(value):.3g} deg"
    return f"{value:.3g}" if p.unit == "1" else f"{value:.3g} {p.unit}"
