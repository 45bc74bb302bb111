"""Formats that cannot carry a smooth remainder refuse a robot with one."""

from __future__ import annotations

from symcal.errors import RefusedError
from symcal.robot.robot import Robot


def refuse_remainder(robot: Robot, format_: str) -> None:
    """Let a robot without a remainder pass to a format that has no room for one.

    Raises:
        RefusedError: it has one.
    """
    if robot.remainder is not None:
        raise RefusedError(
            f"{robot.name} has a smooth remainder of {len(robot.remainder.centres)} centres, which {format_} cannot "
            "carry, and its other numbers hold only together with it: identify with 'remainder: none' to export, or "
            "compensate with symcal"
        )
