"""A robot as the list of turns and shifts that its data sheet gives, with what joints and parameters add to each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.robot.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Element:
    """One turn about, or shift along, axis 0, 1 or 2: by value + rate * q[joint] + x[parameter], rad or mm.

    joint, parameter: None where nothing is added.
    """

    turn: bool
    axis: int
    value: float
    joint: int | None = None
    rate: float = 1.0
    parameter: int | None = None


@dataclass(frozen=True, slots=True)
class Elements:
    """T_world_point = base * motions * tool, frames (4, 4), mm; dof joints and ``count`` parameters."""

    base: Array
    motions: tuple[Element, ...]
    tool: Array
    dof: int
    count: int


_STANDARD = (("theta", True, 2), ("d", False, 2), ("a", False, 0), ("alpha", True, 0), ("beta", True, 1))
_CRAIG = (("alpha", True, 0), ("a", False, 0), ("beta", True, 1), ("theta", True, 2), ("d", False, 2))


def elements(robot: Robot, names: tuple[str, ...], point: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Elements:
    """The robot up to a point in its tool's frame, mm, with errors of the link parameters that are named.

    Raises:
        RefusedError: the robot has joint terms, or a name is none of a link parameter.
    """
    if robot.terms or robot.remainder is not None:
        raise RefusedError("peers know robots without joint terms")
    index = {name: i for i, name in enumerate(names)}
    unknown = set(names) - set(robot.link_parameters)
    if unknown:
        raise RefusedError(f"peers know errors of links alone, not of {', '.join(sorted(unknown))}")
    motions = []
    for i, link in enumerate(robot.links):
        joint = link.joint
        for kind, turn, axis in _STANDARD if robot.convention == "standard" else _CRAIG:
            moved = kind == ("theta" if joint.revolute else "d")
            if kind not in link.parameters and not moved:
                continue
            value = link.parameters.get(kind, 0.0) + (joint.offset if moved else 0.0)
            motions.append(
                Element(
                    turn,
                    axis,
                    value,
                    joint=i if moved else None,
                    rate=joint.sign * joint.ratio if moved else 1.0,
                    parameter=index.get(f"{kind}_{i + 1}"),
                )
            )
    tool = robot.tool.copy()
    tool[:3, 3] += robot.tool[:3, :3] @ np.array(point)
    return Elements(robot.base, tuple(motions), tool, robot.dof, len(names))
