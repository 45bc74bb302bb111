"""The numbers of a setup as symbols, and where features stand in an instrument's frame by them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symcal import kinematics
from symcal.errors import InputError
from symcal.kinematics import Chain, Station
from symcal.model.growth import growth_slope
from symcal.model.observation import Observation, Place, Target
from symcal.model.stages import alike

SX = ca.SX


@dataclass(frozen=True, slots=True)
class Feature:
    """One feature in an instrument's frame, and how parameters turn and move it: shapes (3, 3), (3,), (6, n)."""

    rotation: SX
    point: SX
    twist: SX
    to_world: SX
    own: SX
    by_own: dict[int, int]


@dataclass(frozen=True, slots=True)
class Symbols:
    """The numbers of a setup as symbols, in the order of `Setup.vector`.

    coordinates: of points, by what they are called as parameters. places: of frames. own: numbers of instruments.
    slope: of the growth of all lengths, shape (n,).
    """

    chain: Chain
    setup: SX
    x: dict[str, SX]
    coordinates: dict[str, SX]
    places: dict[str, SX]
    own: dict[str, SX]
    slope: np.ndarray

    @staticmethod
    def of(chain: Chain, observations: tuple[Observation, ...]) -> Symbols:
        parameters = chain.parameters
        x = dict(zip(parameters.names, ca.vertsplit(chain.x), strict=True)) if len(parameters) else {}
        points = {name: SX.sym("point", 3) for name in points_called(observations)}
        frames = {name: SX.sym("place", 12) for name in places_of(observations)}
        own = {name: SX.sym("own") for name in numbers_of(observations)}
        setup = ca.vertcat(chain.frames, *points.values(), *frames.values(), *own.values(), chain.conditions)
        # only where something depends on it: postures that touch, or readings without lengths
        asked = any(o.instrument.constrains or not o.instrument.sees_length for o in observations)
        slope = growth_slope(chain) if asked else np.zeros(len(parameters))
        return Symbols(chain, setup, x, points, frames, own, slope)

    @property
    def growth(self) -> tuple[SX, SX]:
        """g(x) and its slope, shape (1, n)."""
        slope = SX(ca.DM(self.slope)).T
        return 1 + slope @ self.chain.x, slope

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

    def features(self, observation: Observation) -> Iterator[Feature]:
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
            yield Feature(inverse @ axes, inverse @ (at - reader.origin), twist, reader.rotation, own, by_own)

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
