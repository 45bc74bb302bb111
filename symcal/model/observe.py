r"""Instruments read targets: the symbolic measurement of any number of observations of one robot.

With T_world_instrument = (R_i, o_i), a feature of the target at w in world with axes R_t, and the screws of every
parameter of both,

    R = R_i^T R_t,   p = R_i^T (w - o_i),      omega = R_i^T (omega_t - omega_i),   v = R_i^T (v_t(w) - v_i(w))

so the instrument alone says what is read, and how that changes with a twist of the feature; the Jacobian is the chain
rule. A point's own coordinates move it by the columns of R_t. Where data hold the instrument's pose in the target's
frame the two change roles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from symcal import kinematics
from symcal.errors import InputError
from symcal.kinematics import Chain, Station
from symcal.model.facing import limits_of, margins_of
from symcal.model.measurement import Group, Measurement, Part
from symcal.model.observation import Observation, Place, Target
from symcal.model.staged_kernel import StagedKernel, staged_kernel
from symcal.model.stages import alike, stages

SX = ca.SX


def observe(chain: Chain, *observations: Observation) -> Measurement:
    """The measurement of observations: z holds one reading after another, by observation and feature.

    Raises:
        InputError: a place on a link that does not exist.
    """
    scene = _Scene.of(chain, observations)
    state = {"q": chain.q, "x": chain.x, "setup": scene.setup}
    every = _Expressions()
    readings = components = errors = 0
    parts: list[Part] = []
    groups: list[Group] = []
    everything: list[SX] = []
    for i, observation in enumerate(observations):
        kind, own = observation.instrument, _Expressions()
        for feature in () if observation.staged else scene.features(observation):
            own.add(observation, feature)
        size = sum(quantity.size for quantity in kind.quantities)
        count = max(len(observation.features), 1)
        width, m = len(kind.columns) * count, size * count
        judged, turned = kind.error[2] * count, sum(a.numel() for a in own.attitudes)  # of points there are none
        parts.append(
            Part(
                observation,
                slice(readings, readings + width),
                slice(components, components + m),
                slice(errors, errors + judged),
                slice(errors + judged, errors + judged + turned),
                *_functions(scene, state, observation, own, f"o{i}"),  # names of people need not be names of functions
            )
        )
        groups += _groups(observation, components, count, alone=len({o.of for o in observations}) == 1)
        everything += [*own.errors, *own.attitudes]
        every.extend(own)
        readings, components, errors = readings + width, components + m, errors + judged + turned
    n = len(chain.parameters)
    z = _stacked(every.z)
    where = scene.robot_points(observations)
    return Measurement(
        chain=chain,
        parts=tuple(parts),
        groups=_together(groups),
        points_called=tuple(scene.coordinates),
        predict=kinematics.function("predict", state, {"h": _stacked(every.readings)}),
        jacobian=kinematics.function("planned", state, {"J": _stacked(every.planned, n)}),
        accuracy=kinematics.function("accuracy", state | {"z": z}, {"e": _stacked(everything)}),
        points=kinematics.function(
            "points", state, {"p": ca.vertcat(*(p for p, _ in where)), "J": ca.vertcat(*(j for _, j in where))}
        ),
    )


def _functions(
    scene: _Scene, state: dict[str, SX], observation: Observation, own: _Expressions, name: str
) -> tuple[ca.Function | StagedKernel, ca.Function | None]:
    """Residuals of an observation, and its margins unless they are in stages too."""
    if observation.staged:
        numbers, by_own = scene.own_numbers(observation)
        return staged_kernel(stages(state, observation, *scene.ends(observation), numbers, by_own)), None
    residual = kinematics.function(
        f"{name}_residual",
        state | {"z": ca.vertcat(*own.z)},
        {"r": ca.vertcat(*own.residuals), "J": ca.vertcat(*own.jacobians)},
    )
    if not limits_of(observation):
        return residual, None
    return residual, kinematics.function(f"{name}_margins", state, {"m": ca.vertcat(*own.margins)})


def _stacked(rows: list[SX], columns: int = 1) -> SX:
    """Rows one after the other; none at all where every observation is in stages."""
    return ca.vertcat(SX(0, columns), *rows)


def _groups(observation: Observation, start: int, features: int, *, alone: bool) -> Iterator[Group]:
    """Components that share a noise sigma, over all features; one by one where the noise is by axis."""
    kind, prefix = observation.instrument, "" if alone else f"{observation.of} "
    rows, first = sum(quantity.size for quantity in kind.quantities), start
    for quantity in kind.quantities:
        for axis in range(quantity.size if observation.per_axis else 1):
            size = 1 if observation.per_axis else quantity.size
            columns = tuple(rows * k + first + axis + i for k in range(features) for i in range(size))
            suffix = f" {quantity.sigma_columns[axis].removeprefix('sigma_')}" if observation.per_axis else ""
            yield Group(
                f"{prefix}{quantity.noise}{suffix}",
                quantity.unit,
                columns,
                size,
                quantity.floor,
                quantity.alike,
                quantity.noise,
                observation.of,
            )
        first += quantity.size


def _together(groups: list[Group]) -> tuple[Group, ...]:
    """Groups of one name, from sessions of one instrument, as one."""
    found: dict[str, Group] = {}
    for group in groups:
        known = found.get(group.name)
        found[group.name] = group if known is None else replace(known, columns=(*known.columns, *group.columns))
    return tuple(found.values())


@dataclass(frozen=True, slots=True)
class _Feature:
    """One feature in an instrument's frame, and how parameters turn and move it: shapes (3, 3), (3,), (6, n)."""

    rotation: SX
    point: SX
    twist: SX
    to_world: SX
    own: SX
    by_own: dict[int, int]


@dataclass(slots=True)
class _Expressions:
    """What is gathered feature by feature; lives only inside `observe`."""

    z: list[SX] = field(default_factory=list)
    readings: list[SX] = field(default_factory=list)
    residuals: list[SX] = field(default_factory=list)
    jacobians: list[SX] = field(default_factory=list)
    planned: list[SX] = field(default_factory=list)
    errors: list[SX] = field(default_factory=list)
    attitudes: list[SX] = field(default_factory=list)
    margins: list[SX] = field(default_factory=list)

    def add(self, observation: Observation, feature: _Feature) -> None:
        kind, at = observation.instrument, (feature.rotation, feature.point)
        reading = SX.sym("z", len(kind.columns))
        for measured, into in ((reading, self.jacobians), (None, self.planned)):
            by_twist, by_own = kind.slopes(*at, measured, feature.own)
            jacobian = by_twist @ feature.twist
            for i, column in feature.by_own.items():
                jacobian[:, column] = by_own[:, i]
            into.append(jacobian)
        riding = observation.riding and observation.reports == "target"
        shift, attitude = kind.miss(*at, reading, feature.own, riding=riding)
        self.margins.append(margins_of(observation, *at, feature.own))
        self.z.append(reading)
        self.readings.append(kind.predict(*at, feature.own))
        self.residuals.append(kind.residual(*at, reading, feature.own))
        self.errors.append(feature.to_world @ shift if kind.judged_in_world else shift)
        self.attitudes.append(attitude)

    def extend(self, other: _Expressions) -> None:
        self.z += other.z
        self.readings += other.readings
        self.planned += other.planned


@dataclass(frozen=True, slots=True)
class _Scene:
    """The numbers of a setup as symbols, in the order of `Setup.vector`; lives only inside `observe`.

    coordinates: of points, by what they are called as parameters. places: of frames. own: numbers of instruments.
    """

    chain: Chain
    setup: SX
    x: dict[str, SX]
    coordinates: dict[str, SX]
    places: dict[str, SX]
    own: dict[str, SX]

    @staticmethod
    def of(chain: Chain, observations: tuple[Observation, ...]) -> _Scene:
        parameters = chain.parameters
        x = dict(zip(parameters.names, ca.vertsplit(chain.x), strict=True)) if len(parameters) else {}
        points = {name: SX.sym("point", 3) for name in points_called(observations)}
        frames = {name: SX.sym("place", 12) for name in places_of(observations)}
        own = {name: SX.sym("own") for name in numbers_of(observations)}
        setup = ca.vertcat(chain.frames, *points.values(), *frames.values(), *own.values())
        return _Scene(chain, setup, x, points, frames, own)

    def station(self, name: str, place: Place) -> Station:
        if place.on not in self.chain.stations:
            message = "there is no such place on this robot"
            raise InputError(message, key=f"{name}.on", found=place.on, allowed=self.chain.stations)
        on = self.chain.stations[place.on]
        if name not in self.places:
            return on
        return kinematics.placed(on, self.places[name], name, self.chain.parameters, self.x)

    def ends(self, observation: Observation) -> tuple[Station, Station]:
        """The frame that readings are in, and the one that is read."""
        ends = (
            self.station(observation.place, observation.at),
            self.station(observation.target.name, observation.target.at),
        )
        return ends if observation.reports == "target" else (ends[1], ends[0])

    def own_numbers(self, observation: Observation) -> tuple[SX, dict[int, int]]:
        """Numbers of the instrument, and which of them are parameters with their columns."""
        place = {name: i for i, name in enumerate(self.chain.parameters.names)}
        names = [f"{observation.prefix}{name}" for name in observation.instrument.own]
        own = ca.vertcat(*(self.own[name] + self.x.get(name, 0) for name in names))
        return own, {i: place[name] for i, name in enumerate(names) if name in place}

    def features(self, observation: Observation) -> Iterator[_Feature]:
        own, by_own = self.own_numbers(observation)
        reader, read = self.ends(observation)
        turn = kinematics.omegas(read.screws)
        for feature in observation.features or ("",):
            axes, at, motion = read.rotation, *self.feature_point(observation, feature, read)
            if observation.instrument.reads == "axes":
                axes = axes @ SX(_axes_along(observation.target.axes[feature]))
            inverse = reader.rotation.T
            twist = ca.vertcat(
                inverse @ (turn - kinematics.omegas(reader.screws)),
                inverse @ (motion - kinematics.stack(reader.screws, at)),
            )
            yield _Feature(inverse @ axes, inverse @ (at - reader.origin), twist, reader.rotation, own, by_own)

    def feature_point(self, observation: Observation, feature: str, read: Station) -> tuple[SX, SX]:
        """Where a feature is in world, and how parameters move it, shape (3, n)."""
        if observation.instrument.reads != "points":
            return read.origin, kinematics.stack(read.screws, read.origin)
        return self.point(observation.target, feature, read)

    def point(self, target: Target, point: str, on: Station) -> tuple[SX, SX]:
        names = target.coordinates(point)
        offset = ca.vertcat(*(self.x.get(name, 0) for name in names))
        at = on.origin + on.rotation @ (self.coordinates[target.qualified(point)] + offset)
        motion = SX(3, len(self.chain.parameters))
        for axis, name in enumerate(names):
            if name in self.x:
                motion[:, self.chain.parameters.index(name)] = on.rotation[:, axis]
        return at, motion + kinematics.stack(on.screws, at)

    def robot_points(self, observations: tuple[Observation, ...]) -> list[tuple[SX, SX]]:
        """Where the robot's end is, by what is read of it: its points, else the origin of what rides on it."""
        found: dict[tuple[str, str], tuple[SX, SX]] = {}
        for observation in observations:
            if observation.target.at.moves:
                read = self.station(observation.target.name, observation.target.at)
                if observation.staged:
                    for i, c in enumerate(alike(observation.target.nominal)):
                        at = read.origin + read.rotation @ SX(c)
                        found.setdefault((observation.target.name, str(i)), (at, kinematics.stack(read.screws, at)))
                    continue
                for feature in observation.features or ("",):
                    key = (observation.target.name, feature if observation.instrument.reads == "points" else "")
                    if key not in found:
                        found[key] = self.feature_point(observation, feature, read)
            elif observation.at.moves:
                rider = self.station(observation.place, observation.at)
                at = rider.origin
                found.setdefault((observation.place, ""), (at, kinematics.stack(rider.screws, at)))
        tool = self.chain.stations["tool"]
        return list(found.values()) or [(tool.origin, kinematics.stack(tool.screws, tool.origin))]


def points_called(observations: tuple[Observation, ...]) -> tuple[str, ...]:
    """What the points of all targets are called as parameters, each once; the order of a setup's points.

    Not those of targets in one piece, which are no numbers of a setup.
    """
    loose = [o.target for o in observations if not o.target.rigid]
    return tuple(dict.fromkeys(target.qualified(point) for target in loose for point in target.points))


def places_of(observations: tuple[Observation, ...]) -> dict[str, Place]:
    """Frames of instruments and targets that are not those of the robot or the world, by name."""
    found: dict[str, Place] = {}
    for observation in observations:
        for name, place in ((observation.place, observation.at), (observation.target.name, observation.target.at)):
            if place.unknown or place.frame is not None:
                found.setdefault(name, place)
    return found


def numbers_of(observations: tuple[Observation, ...]) -> dict[str, float]:
    """Nominal values of the instruments' own numbers, by their names."""
    return {
        f"{o.prefix}{name}": float(value)
        for o in observations
        for name, value in zip(o.instrument.own, o.instrument.numbers, strict=True)
    }


def _axes_along(axis: tuple[float, float, float]) -> np.ndarray:
    """A rotation whose z axis is along ``axis``."""
    z = np.array(axis) / np.linalg.norm(axis)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
