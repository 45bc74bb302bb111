"""What a program does at each pose of a plan, before it is written in any language."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError, RefusedError
from symcal.robot.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Visits:
    """Poses to drive to one after the other, joint by joint.

    names: of the poses. at: readings there, shape (n, dof), rad and mm. before: readings from which each is approached,
        same shape; None where none was asked for. percent: of the joints' largest speeds. settle: s that the arm stands
        before it is measured. wait: whether the program then stops until somebody starts it again.
    """

    robot: Robot
    names: tuple[str, ...]
    at: Array
    before: Array | None
    percent: float
    settle: float
    wait: bool

    @property
    def shown(self) -> Array:
        """``at`` in deg and mm."""
        return self.at * _factors(self.robot)

    @property
    def shown_before(self) -> Array | None:
        """``before`` in deg and mm."""
        return None if self.before is None else self.before * _factors(self.robot)


def visits(
    robot: Robot,
    names: Sequence[str],
    poses: Array,
    *,
    percent: float = 20.0,
    settle: float = 1.0,
    wait: bool = False,
    approach: float = 0.0,
    directions: Array | None = None,
) -> Visits:
    """Poses with what a program needs to know.

    Args:
        poses: readings, shape (n, dof), rad and mm. approach: deg and mm that every joint moves at last, always in the
            same sense, so that backlash does; 0: straight from the pose before. directions: of that motion, -1 or 1 by
            pose and joint, 0 where it does not matter, shape (n, dof); upwards when None. Where a limit leaves no
            room, a joint comes from the other side.
    Raises:
        InputError: a number that cannot be. RefusedError: a pose outside the limits.
    """
    for value, low, high, key in (
        (percent, 0, 100, "speed"),
        (settle, 0, 600, "settle"),
        (approach, 0, 30, "approach"),
    ):
        if not low <= value <= high or (key == "speed" and value == 0):
            raise InputError("the number is out of range", key=f"--{key}", found=value, allowed=[f"{low} to {high}"])
    outside = np.argwhere((poses < robot.lower - 1e-9) | (poses > robot.upper + 1e-9))
    if len(outside):
        row, i = outside[0]
        raise RefusedError(f"pose {names[row]} has joint {robot.joints[i].name} outside its limits")
    before = None
    if approach or directions is not None:
        before = _before(robot, poses, approach or 2.0, directions)
    return Visits(robot, tuple(names), poses, before, percent, settle, wait)


def _before(robot: Robot, poses: Array, approach: float, directions: Array | None) -> Array:
    step = approach / _factors(robot)
    wanted = np.ones_like(poses) if directions is None else directions
    found = poses - wanted * step
    other = poses + wanted * step
    found = np.where((found >= robot.lower) & (found <= robot.upper), found, other)
    return np.clip(found, robot.lower, robot.upper)


def _factors(robot: Robot) -> Array:
    """deg per rad, mm per mm."""
    return np.where([joint.revolute for joint in robot.joints], np.degrees(1.0), 1.0)
