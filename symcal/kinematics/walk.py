"""Walking along a chain: the pose reached so far, and the screws of the coordinates met on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import casadi as ca

from symcal import spatial
from symcal.joints.remainder import SHIFTS, Remainder
from symcal.kinematics.screws import STILL, Screw, Station, screws_of
from symcal.parameters import ParameterSet, frame_names, link_name
from symcal.robot.robot import ELEMENTS, Convention, Link, is_angle

SX = ca.SX


_NOTHING = SX(3, 1)


def frame_of(vector: SX) -> tuple[SX, SX]:
    upper = ca.reshape(vector, 3, 4)
    return upper[:, :3], upper[:, 3]


def reading_name(i: int) -> str:
    """What the reading of joint i is called among the screws."""
    return f"q_{i}"


def coordinate_name(i: int) -> str:
    """What the coordinate of joint i, rad or mm whatever its ratio, is called among the screws."""
    return f"u_{i}"


@dataclass(frozen=True, slots=True)
class Moves:
    """What joint terms add. delta: by joint, from one. slopes: of delta_i by coordinate, (i, coordinate) -> slope."""

    delta: dict[int, SX]
    slopes: dict[str, list[tuple[int, SX]]]

    def added(self, screws: Mapping[str, Screw]) -> dict[str, Screw]:
        """Screws with what coordinates do through the joints met so far."""
        out = dict(screws)
        for name, slopes in self.slopes.items():
            through = tuple((slope, screws[coordinate_name(i)]) for i, slope in slopes if coordinate_name(i) in screws)
            if through:
                out[name] = replace(screws.get(name, STILL), through=through)
        return out


class Walk:
    """The pose reached so far, and the screws of the coordinates met on the way; lives only inside `chain`."""

    def __init__(self, rotation: SX, origin: SX, moves: Moves | None = None) -> None:
        self.rotation = rotation
        self._turned: SX = rotation
        self._constant: SX | None = None  # since the last turn that was none: multiplied among themselves first
        self.origin = origin
        self.screws: dict[str, Screw] = {}
        self._moves = moves

    def translate(self, axis: int, value: SX, names: tuple[str, ...], rates: tuple[float, ...] = (1.0,)) -> None:
        direction = self.rotation[:, axis]
        for name, rate in zip(names, rates, strict=True):
            self.screws[name] = Screw(_NOTHING, direction if rate == 1 else rate * direction, _NOTHING)
        self.origin = self.origin + value * direction

    def rotate(self, axis: int, value: SX, names: tuple[str, ...], rates: tuple[float, ...] = (1.0,)) -> None:
        omega = self.rotation[:, axis]
        for name, rate in zip(names, rates, strict=True):
            self.screws[name] = Screw(omega if rate == 1 else rate * omega, _NOTHING, self.origin)
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
                self.screws[name] = Screw(omegas[:, k], _NOTHING, self.origin)
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
            screw = self.screws[reading_name(i + 1)]
            self.screws[reading_name(i + 1)] = replace(screw, slide=screw.slide + axes @ slopes[:, i])
        for axis, name in enumerate(SHIFTS):
            if name in x:
                self.screws[name] = Screw(_NOTHING, axes[:, axis], _NOTHING)
        self.origin = self.origin + aside

    def _turn(self, rotation: SX) -> None:
        if rotation.is_constant():
            self._constant = rotation if self._constant is None else self._constant @ rotation
            self.rotation = self._turned @ self._constant
        else:
            self.rotation, self._constant = self.rotation @ rotation, None
            self._turned = self.rotation

    def station(self, parameters: ParameterSet) -> Station:
        """The frame reached so far, with what moved it."""
        return Station(self.rotation, self.origin, screws_of(self.all_screws(), parameters))

    def all_screws(self) -> dict[str, Screw]:
        """The screws of all coordinates, those that act through joint terms included."""
        return self.screws if self._moves is None else self._moves.added(self.screws)

    @property
    def pose(self) -> SX:
        return ca.vertcat(ca.horzcat(self.rotation, self.origin), SX([[0, 0, 0, 1]]))


def walk_link(
    walk: Walk, convention: Convention, i: int, link: Link, q: SX, error: dict[str, SX], delta: SX | None
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
            value, names, rates = value + rate * q + joint.offset, (*names, reading_name(i)), (*rates, rate)
            if delta is not None:
                value, names, rates = value + delta, (*names, coordinate_name(i)), (*rates, 1.0)
        (walk.rotate if is_angle(kind) else walk.translate)(axis, value, names, rates)
        if axis == 2:  # theta and d: the joint's own motion
            at = walk.rotation, walk.origin
    return at
