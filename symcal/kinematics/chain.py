"""A robot's symbolic forward kinematics for a set of parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.joints.remainder import SHIFTS
from symcal.kinematics.functions import function
from symcal.kinematics.screws import Screw, Station, omegas, pose_of, screws_of, stack
from symcal.kinematics.terms import moves_of
from symcal.kinematics.walk import Walk, frame_of, reading_name, walk_link
from symcal.parameters import ParameterSet
from symcal.robot.robot import Robot

SX = ca.SX
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Chain:
    """A robot's symbolic forward kinematics.

    q: joint readings, shape (dof,), rad or mm. x: parameter errors in the order of ``parameters``.
    conditions: what else of a pose joint terms ask for (`Robot.conditions`); empty where all are nominal.
    frames: the nominal base and tool frames as numbers to be given at evaluation, shape (24,), see `frame_vector`.
    flange, tool: T_world_flange and T_world_tool, shape (4, 4), mm. on_links: every link's frame.
    joint_screws, parameter_screws: one per q and per x (a parameter of a tool *point* moves no frame: zero).
    stations: where things can stand: `world`, `base`, the frames of the links by their joints' names, `flange`, `tool`.
    """

    robot: Robot
    parameters: ParameterSet
    q: SX
    x: SX
    frames: SX
    conditions: SX
    flange: SX
    tool: SX
    on_links: tuple[Station, ...]
    joint_screws: tuple[Screw, ...]
    parameter_screws: tuple[Screw, ...]
    stations: Mapping[str, Station]

    @property
    def links(self) -> tuple[SX, ...]:
        """T_world_i of every link's frame, shape (4, 4), mm."""
        return tuple(pose_of(station) for station in self.on_links)


def station_names(robot: Robot) -> tuple[str, ...]:
    """Where things can stand; the names of `Chain.stations`. A joint of a name that is taken lends its link none."""
    own = ("world", "base", "flange", "tool")
    return (*own, *(name for name in dict.fromkeys(joint.name for joint in robot.joints) if name not in own))


def frame_vector(base: Array, tool: Array) -> Array:
    """Base and tool (4, 4) as the vector that `Chain.frames` stands for: upper three rows of each, by columns."""
    return np.concatenate([base[:3].ravel(order="F"), tool[:3].ravel(order="F")])


def chain(robot: Robot, parameters: ParameterSet, *, conditions: bool = False) -> Chain:
    """Build the symbolic kinematics of a robot for a parameter set.

    T_world_tool = base * base increment * T_1 ... T_n * tool * tool increment; see `symcal.robot.robot` for T_i.

    Args:
        conditions: whether those that joint terms ask for are symbols; otherwise they are nominal.
    """
    q, x = SX.sym("q", robot.dof), SX.sym("x", len(parameters))
    given = SX.sym("conditions", len(robot.conditions) if conditions else 0)
    frames = SX.sym("frames", 24)
    error = dict(zip(parameters.names, ca.vertsplit(x), strict=True)) if len(parameters) else {}
    moves = moves_of(robot, q, x, error, given)
    walk = Walk(*frame_of(frames[:12]), moves)
    walk.increment("base", error)
    world, base = Station(SX.eye(3), SX(3, 1), screws_of({}, parameters)), walk.station(parameters)
    links: list[Station] = []
    for i, link in enumerate(robot.links, start=1):
        walk_link(walk, robot.convention, i, link, q[i - 1], error, moves.delta.get(i))
        links.append(walk.station(parameters))
    if robot.remainder is not None or not set(SHIFTS).isdisjoint(error):
        walk.displace(base.rotation, robot.remainder, q, error)
    flange, at_flange = walk.pose, walk.station(parameters)
    walk.place(*frame_of(frames[12:]))
    walk.increment("tool", error)
    tool = walk.station(parameters)
    named = {link.joint.name: station for link, station in zip(robot.links, links, strict=True)}
    return Chain(
        robot=robot,
        parameters=parameters,
        q=q,
        x=x,
        frames=frames,
        conditions=given,
        flange=flange,
        tool=walk.pose,
        on_links=tuple(links),
        joint_screws=tuple(walk.all_screws()[reading_name(i)] for i in range(1, robot.dof + 1)),
        parameter_screws=screws_of(walk.all_screws(), parameters),
        stations={**named, "world": world, "base": base, "flange": at_flange, "tool": tool},
    )


def placed(on: Station, nominal: SX, frame: str, parameters: ParameterSet, x: dict[str, SX]) -> Station:
    """A frame that is no part of the robot's chain, where it stands on a station.

    Args:
        nominal: its upper three rows by columns in the station's frame, shape (12,). frame: name of its increments.
        x: errors by parameter name; those of ``frame`` count.
    """
    walk = Walk(on.rotation, on.origin)
    walk.place(*frame_of(nominal))
    walk.increment(frame, x)
    own = zip(parameters.names, on.screws, strict=True)
    return Station(walk.rotation, walk.origin, tuple(walk.screws.get(name, screw) for name, screw in own))


def forward(model: Chain) -> ca.Function:
    """(q, x, frames) -> T_world_tool (4, 4), the Jacobian of the tool by joints (6, dof) and by parameters (6, n).

    A Jacobian's upper three rows are the velocity of the tool's origin (mm per unit), the lower three the angular
    velocity (rad per unit), both in world.
    """
    origin = model.tool[:3, 3]
    return function(
        "forward",
        {"q": model.q, "x": model.x, "frames": model.frames},
        {
            "pose": model.tool,
            "joint_jacobian": ca.vertcat(stack(model.joint_screws, origin), omegas(model.joint_screws)),
            "parameter_jacobian": ca.vertcat(stack(model.parameter_screws, origin), omegas(model.parameter_screws)),
        },
    )
