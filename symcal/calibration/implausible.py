"""Identified errors that are no errors of a robot: far beyond what is plausible."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from symcal.calibration.reasons import Reason
from symcal.parameters import Parameter
from symcal.robot.robot import Robot

IMPLAUSIBLE = 10.0
"""Plausible scales beyond which an error of a link or joint term is taken for a mistake: 10 mm, 0.1 rad by default."""
FAR = 50.0
"""Plausible scales beyond which nothing makes an error plausible."""
_NAMED = 5


def implausible(robot: Robot) -> tuple[Reason, ...]:
    """Corrections of a calibrated robot that are implausibly large; none of a nominal one.

    Link parameters and joint terms are judged. The base says where the instrument stood, and nominal tools are often
    rough guesses: the sizes of their errors do not count. How large a group of joint terms is the data may have told,
    which is then its plausible size (`size_factors` of the provenance). The limit is ours.
    """
    found = []
    for p, error, told in _beyond(robot):
        if not told:
            limit = f"{IMPLAUSIBLE:g} times its plausible {_text(p, p.scale)}"
            found.append(Reason("implausible", f"{p.name} is off by {_text(p, error)}, more than {limit}", p.name))
    return tuple(found)


def conceivable(robot: Robot) -> frozenset[str]:
    """Parameters beyond measure that an error of the robot file may explain: what unseen poses confirm."""
    return frozenset(p.name for p, error, _ in _beyond(robot) if abs(error) <= FAR * p.scale)


def large_terms(robot: Robot) -> tuple[str, ...]:
    """Joint terms that are as large only because the data say so, in a sentence; empty where there are none."""
    large = [f"{p.name} {_text(p, error)}" for p, error, told in _beyond(robot) if told]
    if not large:
        return ()
    more = f" and {len(large) - _NAMED} more" if len(large) > _NAMED else ""
    return (
        f"joint terms of more than {IMPLAUSIBLE:g} times their usual size are there because the data ask for them: "
        f"{', '.join(large[:_NAMED])}{more}",
    )


def _beyond(robot: Robot) -> Iterator[tuple[Parameter, float, bool]]:
    """Numbers beyond measure, their errors, and whether the data told the size of their group."""
    record = robot.record
    if record is None:
        return
    factors = record.provenance.get("size_factors") or {}
    for p in robot.described:
        error = record.errors.get(p.name, 0.0)
        if abs(error) > IMPLAUSIBLE * p.scale:
            yield p, error, abs(error) <= IMPLAUSIBLE * p.scale * float(factors.get(p.group, 1.0))


def _text(p: Parameter, value: float) -> str:
    if p.unit == "rad":
        return f"{np.degrees(value):.3g} deg"
    return f"{value:.3g}" if p.unit == "1" else f"{value:.3g} {p.unit}"
