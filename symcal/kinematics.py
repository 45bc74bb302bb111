"""The one kinematic expression: robot -> symbolic pose and the screws of every joint and parameter.

Simulation, identification, planning, compensation and exported C all come from `chain`. The Jacobians are geometric:
each coordinate s (a joint reading or a parameter error) moves whatever is fixed to the tool with the velocity field

    dp/ds = v + omega x p        (p in world)

so a measurement needs only the screws (omega, v) and the derivative of its own last step. It is the derivative that
automatic differentiation gives, with about half the operations (the tests compare the two).

Joint terms (`symcal.joints`) move a joint by delta_i(q, x): whatever changes delta_i turns what is behind joint i about
its axis, so the screw of a coordinate s gains sum_i (d delta_i / ds) U_i, U_i the screw of joint i.
A remainder (`symcal.joints.remainder`) displaces the flange by f(q) along the axes of the base: the screw of joint i
gains the slide df/dq_i.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.joints.arm import Arm
from symcal.joints.remainder import SHIFTS, Remainder
from symcal.parameters import ParameterSet, frame_names, link_name
from symcal.robot.robot import ELEMENTS, Convention, Link, Robot, is_angle

SX = ca.SX
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Screw:
    """Velocity field of one coordinate: a turn about an axis through ``origin``, and a slide; in world, (3,).

    dp/ds = slide + turn x (p - origin) + sum_i c_i (dp/ds)_i = v + omega x p

    through: what the coordinate does through joint terms: slopes c_i and the screws of the joints.
    """

    turn: SX
    slide: SX
    origin: SX
    through: tuple[tuple[SX, Screw], ...] = ()

    @property
    def omega(self) -> SX:
        """Angular velocity; shape (3,)."""
        return sum((c * screw.omega for c, screw in self.through), self.turn)

    @property
    def v(self) -> SX:
        """Velocity of the tool-fixed point that is at the origin of world; shape (3,)."""
        return self.at(SX(3, 1))

    def at(self, point: SX) -> SX:
        """Velocity of a point fixed to the tool, in world; shape (3,)."""
        own = self.slide + ca.cross(self.turn, point - self.origin)
        return sum((c * screw.at(point) for c, screw in self.through), own)


@dataclass(frozen=True, slots=True)
class Station:
    """A frame in world that moves with the robot or stands still: rotation (3, 3), origin (3,), mm.

    screws: one per parameter: how the frame moves with it.
    """

    rotation: SX
    origin: SX
    screws: tuple[Screw, ...]


@dataclass(frozen=True, slots=True)
class Chain:
    """A robot's symbolic forward kinematics.

    q: joint readings, shape (dof,), rad or mm. x: parameter errors in the order of ``parameters``.
    conditions: what else of a pose joint terms ask for (`Robot.conditions`); empty where all are nominal.
    frames: the nominal base and tool frames as numbers to be given at evaluation, shape (24,), see `frame_vector`.
    flange, tool: T_world_flange and T_world_tool, shape (4, 4), mm. links: T_world_i of every link frame.
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
    links: tuple[SX, ...]
    joint_screws: tuple[Screw, ...]
    parameter_screws: tuple[Screw, ...]
    stations: Mapping[str, Station]


def station_names(robot: Robot) -> tuple[str, ...]:
    """Where things can stand; the names of `Chain.stations`. A joint of a name that is taken lends its link none."""
    own = ("world", "base", "flange", "tool")
    return (*own, *(name for name in dict.fromkeys(joint.name for joint in robot.joints) if name not in own))


def frame_vector(base: Array, tool: Array) -> Array:
    """Base and tool (4, 4) as the vector that `Chain.frames` stands for: upper three rows of each, by columns."""
    return np.concatenate([base[:3].ravel(order="F"), tool[:3].ravel(order="F")])


def _frame(vector: SX) -> tuple[SX, SX]:
    upper = ca.reshape(vector, 3, 4)
    return upper[:, :3], upper[:, 3]


class _Walk:
    """The pose reached so far, and the screws of the coordinates met on the way; lives only inside `chain`."""

    def __init__(self, rotation: SX, origin: SX, moves: _Moves | None = None) -> None:
        self._turned, self._constant = rotation, SX.eye(3)
        self.origin = origin
        self.screws: dict[str, Screw] = {}
        self._moves = moves

    @property
    def rotation(self) -> SX:
        """The rotation so far; constant ones since the last that was not are multiplied among themselves first."""
        return self._turned @ self._constant

    def translate(self, axis: int, value: SX, names: tuple[str, ...], rates: tuple[float, ...] = (1.0,)) -> None:
        direction = self.rotation[:, axis]
        for name, rate in zip(names, rates, strict=True):
            self.screws[name] = Screw(SX(3, 1), rate * direction, SX(3, 1))
        self.origin = self.origin + value * direction

    def rotate(self, axis: int, value: SX, names: tuple[str, ...], rates: tuple[float, ...] = (1.0,)) -> None:
        omega = self.rotation[:, axis]
        for name, rate in zip(names, rates, strict=True):
            self.screws[name] = Screw(rate * omega, SX(3, 1), self.origin)
        self._turn(spatial.rotation(axis, value))

    def place(self, rotation: SX, origin: SX) -> None:
        """A constant transform."""
        self.origin = self.origin + self.rotation @ origin
        self._turn(rotation)

    def increment(self, frame: str, x: dict[str, SX]) -> None:
        """The increments of a frame, on the right of its nominal value: translation, then a rotation vector."""
        names = frame_names(frame)
        for axis, name in enumerate(names[:3]):
            if name in x:
                # all three move along the axes of the nominal frame, so their order does not matter
                self.translate(axis, x[name], (name,))
        if any(name in x for name in names[3:]):
            r = ca.vertcat(*(x.get(name, 0) for name in names[3:]))
            omegas = self.rotation @ spatial.left_jacobian(r)
            for k, name in enumerate(names[3:]):
                self.screws[name] = Screw(omegas[:, k], SX(3, 1), self.origin)
            self._turn(spatial.exp_rotation(r))

    def displace(self, axes: SX, remainder: Remainder | None, q: SX, x: dict[str, SX]) -> None:
        """A displacement along the axes of the base, by f(q) and by the parameters of a shift.

        It does not turn with the links: what they turn by is as if they stood that much aside.
        """
        moved = ca.vertcat(*(x.get(name, 0) for name in SHIFTS))
        slopes = SX(3, q.numel())
        if remainder is not None:
            value, slopes = remainder.expression(q)
            moved = moved + value
        aside = axes @ moved
        for name in self.screws.keys() - set(frame_names("base")):
            self.screws[name] = replace(self.screws[name], origin=self.screws[name].origin + aside)
        for i in range(q.numel()):
            screw = self.screws[_joint(i + 1)]
            self.screws[_joint(i + 1)] = replace(screw, slide=screw.slide + axes @ slopes[:, i])
        for axis, name in enumerate(SHIFTS):
            if name in x:
                self.screws[name] = Screw(SX(3, 1), axes[:, axis], SX(3, 1))
        self.origin = self.origin + aside

    def _turn(self, rotation: SX) -> None:
        if rotation.is_constant():
            self._constant = self._constant @ rotation
        else:
            self._turned, self._constant = self.rotation @ rotation, SX.eye(3)

    def station(self, parameters: ParameterSet) -> Station:
        """The frame reached so far, with what moved it."""
        return Station(self.rotation, self.origin, _screws(self.all_screws(), parameters))

    def all_screws(self) -> dict[str, Screw]:
        """The screws of all coordinates, those that act through joint terms included."""
        return self.screws if self._moves is None else self._moves.added(self.screws)

    @property
    def pose(self) -> SX:
        return ca.vertcat(ca.horzcat(self.rotation, self.origin), SX([[0, 0, 0, 1]]))


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
    moves = _moves(robot, q, x, error, given)
    walk = _Walk(*_frame(frames[:12]), moves)
    walk.increment("base", error)
    world, base = Station(SX.eye(3), SX(3, 1), _screws({}, parameters)), walk.station(parameters)
    links, on_links = [], {}
    for i, link in enumerate(robot.links, start=1):
        _walk_link(walk, robot.convention, i, link, q[i - 1], error, moves.delta.get(i))
        links.append(walk.pose)
        on_links[link.joint.name] = walk.station(parameters)
    if robot.remainder is not None or not set(SHIFTS).isdisjoint(error):
        walk.displace(base.rotation, robot.remainder, q, error)
    flange, at_flange = walk.pose, walk.station(parameters)
    walk.place(*_frame(frames[12:]))
    walk.increment("tool", error)
    tool = walk.station(parameters)
    return Chain(
        robot=robot,
        parameters=parameters,
        q=q,
        x=x,
        frames=frames,
        conditions=given,
        flange=flange,
        tool=walk.pose,
        links=tuple(links),
        joint_screws=tuple(walk.all_screws()[_joint(i)] for i in range(1, robot.dof + 1)),
        parameter_screws=_screws(walk.all_screws(), parameters),
        stations={**on_links, "world": world, "base": base, "flange": at_flange, "tool": tool},
    )


def _screws(found: Mapping[str, Screw], parameters: ParameterSet) -> tuple[Screw, ...]:
    return tuple(found.get(name, _STILL) for name in parameters.names)


def placed(on: Station, nominal: SX, frame: str, parameters: ParameterSet, x: dict[str, SX]) -> Station:
    """A frame that is no part of the robot's chain, where it stands on a station.

    Args:
        nominal: its upper three rows by columns in the station's frame, shape (12,). frame: name of its increments.
        x: errors by parameter name; those of ``frame`` count.
    """
    walk = _Walk(on.rotation, on.origin)
    walk.place(*_frame(nominal))
    walk.increment(frame, x)
    own = zip(parameters.names, on.screws, strict=True)
    return Station(walk.rotation, walk.origin, tuple(walk.screws.get(name, screw) for name, screw in own))


def _joint(i: int) -> str:
    """What the reading of joint i is called among the screws."""
    return f"q_{i}"


def _axis(i: int) -> str:
    """What the coordinate of joint i, rad or mm whatever its ratio, is called among the screws."""
    return f"u_{i}"


@dataclass(frozen=True, slots=True)
class _Moves:
    """What joint terms add. delta: by joint, from one. slopes: of delta_i by coordinate, (i, coordinate) -> slope."""

    delta: dict[int, SX]
    slopes: dict[str, list[tuple[int, SX]]]

    def added(self, screws: Mapping[str, Screw]) -> dict[str, Screw]:
        """Screws with what coordinates do through the joints met so far."""
        out = dict(screws)
        for name, slopes in self.slopes.items():
            through = tuple((slope, screws[_axis(i)]) for i, slope in slopes if _axis(i) in screws)
            if through:
                out[name] = replace(screws.get(name, _STILL), through=through)
        return out


_STILL = Screw(SX(3, 1), SX(3, 1), SX(3, 1))


def _moves(robot: Robot, q: SX, x: SX, error: dict[str, SX], conditions: SX) -> _Moves:
    """delta(q, x) of the robot's joint terms and its derivatives."""
    if not robot.terms:
        return _Moves({}, {})
    arm, delta = _arm(robot, q, error, conditions), dict[int, SX]()
    for term in robot.terms:
        basis = term.basis(arm)
        values = {p.name: p.value + error.get(p.name, 0) for p in term.parameters}
        own = sum((values[term.name(label)] * slope for label, slope in basis.items()), SX(0))
        delta[term.joint] = delta.get(term.joint, SX(0)) + own
    slopes: dict[str, list[tuple[int, SX]]] = {}
    for i, moved in sorted(delta.items()):
        for names, by in (([_joint(j) for j in range(1, robot.dof + 1)], q), (list(error), x)):
            gradient = ca.jacobian(moved, by)
            for column, name in enumerate(names):
                slope = gradient[0, column]
                if not slope.is_zero():
                    slopes.setdefault(name, []).append((i, slope))
    return _Moves(delta, slopes)


def bases(robot: Robot) -> ca.Function:
    """q -> what the numbers of joint terms move their joints by, per unit, at nominal conditions; shape (numbers,).

    In the order of `Robot.term_parameters`; rad or mm per unit.
    """
    q = SX.sym("q", robot.dof)
    arm = _arm(robot, q, {}, SX(0, 1))
    found = [slope for term in robot.terms for slope in term.basis(arm).values()]
    return function("bases", {"q": q}, {"b": ca.vertcat(*found)})


def _arm(robot: Robot, q: SX, error: dict[str, SX], conditions: SX) -> Arm:
    """What joint terms may ask; where the links are only if one of them does."""
    joints = robot.joints
    moved = ca.vertcat(*(joint.sign * joint.ratio * q[i] for i, joint in enumerate(joints)))
    frames: list[tuple[SX, SX]] = []
    if any(term.needs_arm for term in robot.terms):
        walk = _Walk(SX.eye(3), SX(3, 1))
        for i, link in enumerate(robot.links, start=1):
            frames.append(_walk_link(walk, robot.convention, i, link, q[i - 1], error, None))
        frames.append((walk.rotation, walk.origin))
    return Arm(
        q=q,
        moved=moved,
        revolute=tuple(joint.revolute for joint in joints),
        frames=tuple(frames),
        down=robot.down,
        conditions={n: conditions[k] if k < conditions.numel() else SX(0) for k, n in enumerate(robot.conditions)},
        masses=robot.masses,
        payload=robot.payload,
    )


def _walk_link(
    walk: _Walk, convention: Convention, i: int, link: Link, q: SX, error: dict[str, SX], delta: SX | None
) -> tuple[SX, SX]:
    """Walk over one link, its joint moved by ``delta`` beside its reading; the joint's frame on the way."""
    at = walk.rotation, walk.origin
    joint = link.joint
    moved = "theta" if joint.revolute else "d"
    rate = joint.sign * joint.ratio
    for kind, axis in ELEMENTS[convention]:
        if kind not in link.parameters and kind != moved:
            continue
        value = SX(link.parameters.get(kind, 0.0))
        names: tuple[str, ...] = ()
        rates: tuple[float, ...] = ()
        own = link_name(kind, i)
        if own in error:
            value, names, rates = value + error[own], (own,), (1.0,)
        if kind == moved:
            value, names, rates = value + rate * q + joint.offset, (*names, _joint(i)), (*rates, rate)
            if delta is not None:
                value, names, rates = value + delta, (*names, _axis(i)), (*rates, 1.0)
        (walk.rotate if is_angle(kind) else walk.translate)(axis, value, names, rates)
        if axis == 2:  # theta and d: the joint's own motion
            at = walk.rotation, walk.origin
    return at


def stack(screws: tuple[Screw, ...], point: SX) -> SX:
    """Velocities in world of a tool-fixed point for each screw; shape (3, len(screws))."""
    return ca.horzcat(*(screw.at(point) for screw in screws)) if screws else SX(3, 0)


def omegas(screws: tuple[Screw, ...]) -> SX:
    """Angular velocities in world for each screw; shape (3, len(screws))."""
    return ca.horzcat(*(screw.omega for screw in screws)) if screws else SX(3, 0)


def function(name: str, inputs: dict[str, SX], outputs: dict[str, SX]) -> ca.Function:
    """A named function of dense outputs with common subexpressions shared."""
    dense = ca.cse([ca.densify(expression) for expression in outputs.values()])
    return ca.Function(name, list(inputs.values()), dense, list(inputs), list(outputs))


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


def pose_of(station: Station) -> SX:
    """T_world_station, shape (4, 4)."""
    return ca.vertcat(ca.horzcat(station.rotation, station.origin), SX([[0, 0, 0, 1]]))
