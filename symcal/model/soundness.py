"""What cannot be measured or found together, each with its sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symcal.errors import InputError
from symcal.kinematics import station_names
from symcal.model.observation import Observation, Place
from symcal.parameters import frame_names
from symcal.robot.robot import Robot


def insist_on_sense(
    observations: Sequence[Observation], values: Sequence[Observation], *, base: bool, tool: bool, robot: Robot
) -> None:
    """Refuse places that nothing could tell, whatever is measured.

    Args:
        values: what is known between things. base, tool: whether the robot's own frames are unknown.
    Raises:
        InputError: with the entry under `measurements`, or the part of the robot, as its key.
    """
    if not observations:
        raise InputError("nothing is measured", key="measurements")
    names = [o.name for o in (*observations, *values)]
    for name in names:
        if names.count(name) > 1:
            raise InputError("two instruments have this name", key=f"measurements.{name}", found=name)
    for observation in observations:
        _one(observation, robot)
    for value in values:
        _known(value, observations, robot)
    _world(observations, base)
    _tool(observations, tool)


def _known(value: Observation, observations: Sequence[Observation], robot: Robot) -> None:
    """What is known between two things: they do not move against each other, and something measures them."""
    key = f"measurements.{value.of}"
    _ends(value, robot)
    kind, given = value.instrument, np.asarray(value.value, dtype=float)
    if kind.constrains:
        message = "a contact has no value: say where its place is"
        raise InputError(message, key=f"{key}.value", found=kind.name)
    if kind.has_unknowns:
        message = "a value says nothing of an instrument that has unknown numbers of its own: leave them out"
        raise InputError(message, key=key, found=kind.unknowns(value.prefix)[0][0].name)
    if given.shape != (len(kind.columns) * max(len(value.features), 1),) or not np.isfinite(given).all():
        columns = ", ".join(name for name, _ in kind.columns)
        raise InputError("a value is what would be read, each a number", key=f"{key}.value", allowed=columns)
    if _joint_between(value, robot):
        message = "joints move these two against each other: a value is for things that stand still to one another"
        raise InputError(message, key=f"{key}.value")
    for quantity in kind.quantities:
        if quantity.noise not in value.noise:
            message = "say how well the value is known"
            raise InputError(message, key=f"{key}.noise", allowed=[q.noise for q in kind.quantities])
    known = {name for o in observations for name in o.things}
    for thing in value.things:
        if thing not in known:
            message = "nothing else is measured of this thing, so nothing is known by this value"
            raise InputError(message, key=key, found=thing, allowed=sorted(known))


def _joint_between(o: Observation, robot: Robot) -> bool:
    """Whether joints move the two ends against each other."""
    if not o.at.moves and not o.target.at.moves:
        return False
    return not o.at.moves or _body(o.at, robot) != _body(o.target.at, robot)


def _ends(o: Observation, robot: Robot) -> None:
    """Both ends are on this robot or off it, and noise is of what is read."""
    key = f"measurements.{o.name}"
    for place, what in ((o.at, "at"), (o.target.at, "target")):
        if place.on not in station_names(robot):
            message = "there is no such place on this robot"
            raise InputError(message, key=f"{key}.{what}.on", found=place.on, allowed=station_names(robot))
    quantities = [q.noise for q in o.instrument.quantities]
    for quantity in o.noise:
        if quantity not in quantities:
            raise InputError("nothing of this is read", key=f"{key}.noise", found=quantity, allowed=quantities)


def _one(o: Observation, robot: Robot) -> None:
    """The two ends of one observation."""
    key = f"measurements.{o.name}"
    _ends(o, robot)
    here = o.at.frame is None and not o.at.unknown
    if o.at.on == "world" and here and not o.instrument.makes_world:
        message = (
            f"where does it stand? Its {o.instrument.label} do not make a world of their own: say 'at: {{on: world, "
            "place: {xyz: [..]}}', or 'place: unknown'"
        )
        raise InputError(message, key=f"{key}.at")
    if not _joint_between(o, robot):
        where = f"both on {o.at.on}" if o.at.moves else "both off the robot"
        message = (
            f"instrument and target are {where}: the joints cancel and the readings say nothing of them; what is known "
            "between the two is a 'value'"
        )
        raise InputError(message, key=f"{key}.at.on", found=o.at.on)
    if o.instrument.constrains and len(o.target.points) > 1:
        message = "one point of the robot touches: give each point an entry of its own"
        raise InputError(message, key=f"{key}.target.points", found=", ".join(o.target.points))
    if o.instrument.reads == "points" and not o.target.points:
        message = f"{o.instrument.label} are read of points, and the target has none"
        raise InputError(message, key=f"{key}.target.points")
    if o.instrument.reads == "axes" and not o.target.axes:
        message = f"{o.instrument.label} are read of axes, and the target has none"
        raise InputError(message, key=f"{key}.target.axes")
    points = o.target.points if o.instrument.reads == "points" else {}
    if o.target.at.unknown and points and len(o.target.unknown_points) == len(points):
        message = "the target's place and all its points are unknown: moving one is moving the others; say one of them"
        raise InputError(message, key=f"{key}.target")
    if o.reports == "instrument" and o.instrument.reads != "frame":
        message = "only where whole frames are read can data report the instrument's pose"
        raise InputError(message, key=f"{key}.reports")


def insist_on_values(observations: Sequence[Observation], held: Sequence[str]) -> None:
    """Refuse to hold or draw to its nominal value what has none: unknown places and points without a guess, numbers.

    Args:
        held: names of parameters that are fixed or have a prior.
    Raises:
        InputError: with the parameter's name.
    """
    without: dict[str, str] = {}
    for o in observations:
        for place, name in ((o.at, o.place), (o.target.at, o.target.name)):
            if place.unknown and place.frame is None:
                without |= dict.fromkeys(frame_names(name), "a first guess under 'near'")
        for point in o.target.unknown_points:
            if o.target.points[point] is None and point not in o.target.near:
                without |= dict.fromkeys(o.target.coordinates(point), "a first guess: '{near: [x, y, z]}'")
        if not o.instrument.is_camera:
            names = [item.name for item in o.instrument.unknowns(o.prefix)[0] if item.unknown]
            without |= dict.fromkeys(names, "its value instead of 'unknown'")
    for name in held:
        if name in without:
            message = f"nothing is said of where this parameter is, so it cannot be held there: give {without[name]}"
            raise InputError(message, key=name, found=name)


def _body(place: Place, robot: Robot) -> str:
    """The rigid body that a place is on: flange and tool are the last link's, the base is not the world's."""
    return robot.joints[-1].name if place.on in ("flange", "tool") else place.on


def _world(observations: Sequence[Observation], base: bool) -> None:
    ends = [(o, p, n) for o in observations for p, n in ((o.at, o.place), (o.target.at, o.target.name))]
    world = [(o, place) for o, place, _ in ends if place.on == "world"]
    if base and not world:
        message = "nothing that measures stands on world, so nothing says where the base is: say 'base: known'"
        raise InputError(message, key="base")
    if base and all(place.unknown for _, place in world):
        message = (
            "base and every place on world are unknown: moving the robot is moving everything in the world; place one "
            "thing, or say 'base: known'"
        )
        raise InputError(message, key="base")
    bare = {o.place: o for o in observations if o.at.on == "world" and not o.at.unknown and o.at.frame is None}
    if len(bare) > 1:
        first, second = list(bare)[:2]
        message = (
            f"'{first}' and '{second}' are both on world without a place, and would stand at one spot: say where one "
            f"of them is, or 'place: unknown', or 'at: {first}' if it is the same instrument in the same place"
        )
        raise InputError(message, key=f"measurements.{bare[second].name}.at", found=second)


def _tool(observations: Sequence[Observation], tool: bool) -> None:
    if not tool:
        return
    riders = [
        unknown
        for o in observations
        for place, unknown in (
            (o.at, o.at.unknown),
            (o.target.at, o.target.at.unknown or bool(o.instrument.reads == "points" and _all_unknown(o))),
        )
        if place.on == "tool"
    ]
    if not riders:
        message = "nothing that measures or is measured is on the tool: say 'tool: known', or 'on: tool'"
        raise InputError(message, key="tool")
    if all(riders):
        message = (
            "'tool' and 'points' (or places on it) cannot both be estimated: moving the tool is moving everything on it"
        )
        raise InputError(message, key="tool")


def _all_unknown(o: Observation) -> bool:
    return len(o.target.unknown_points) == len(o.target.points)
