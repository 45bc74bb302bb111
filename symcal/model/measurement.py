"""What the instruments read of a robot, as compiled functions of joint readings, errors and frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal import kinematics, spatial
from symcal.kinematics import Chain, frame_vector
from symcal.model.observation import Observation
from symcal.model.staged_kernel import StagedKernel
from symcal.parameters import ParameterSet, Unit, coordinate_names, frame_names

SX = ca.SX
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Setup:
    """Where things nominally are: numbers that a model is given at evaluation, and that its increments refer to.

    base: T_world_base, tool: T_flange_tool, shape (4, 4), mm. points: of all targets in their frames, shape (k, 3), mm.
    places: frames of instruments and targets by name, each where it stands, shape (4, 4), mm. own: numbers of the
    instruments by name, one instrument after the other. conditions: what joint terms ask of a pose; zero is nominal.
    """

    base: Array
    tool: Array
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))
    places: Mapping[str, Array] = field(default_factory=dict)
    own: Mapping[str, float] = field(default_factory=dict)
    conditions: tuple[str, ...] = ()

    @property
    def vector(self) -> Array:
        """The numbers at nominal conditions, shape (k,)."""
        parts = [frame_vector(self.base, self.tool), self.points.ravel()]
        parts += [place[:3].ravel(order="F") for place in self.places.values()]
        return np.concatenate([*parts, list(self.own.values()), np.zeros(len(self.conditions))])

    def under(self, given: Mapping[str, Array]) -> Array:
        """The numbers under the conditions of N poses, shape (N, k), by name, shape (N,); (k,) if none matters."""
        wanted = [name for name in self.conditions if name in given]
        if not wanted:
            return self.vector
        count, first = len(given[wanted[0]]), len(self.vector) - len(self.conditions)
        out = np.tile(self.vector, (count, 1))
        for name in wanted:
            out[:, first + self.conditions.index(name)] = given[name]
        return out

    def moved(self, errors: Mapping[str, float], points: Iterable[str] = ()) -> Setup:
        """The setup with the increments of base, tool, places and points in ``errors`` (mm, rad) carried out.

        Numbers of instruments stay: their errors are from what their nominal values were found with.

        Args:
            points: what the points are called as parameters, in their order (`Measurement.points_called`).
        """
        shifts = [[errors.get(c, 0.0) for c in coordinate_names(name)] for name in points]
        return replace(
            self,
            base=_moved(self.base, "base", errors),
            tool=_moved(self.tool, "tool", errors),
            points=self.points + np.array(shifts).reshape(self.points.shape) if shifts else self.points,
            places={name: _moved(place, name, errors) for name, place in self.places.items()},
        )


def _moved(frame: Array, name: str, errors: Mapping[str, float]) -> Array:
    increment = np.array([errors.get(axis, 0.0) for axis in frame_names(name)])
    rotation = spatial.vector_matrix(increment[3:])
    return np.asarray(frame @ spatial.transform(rotation, increment[:3]))


@dataclass(frozen=True, slots=True)
class Group:
    """Residual components that share one noise sigma.

    name: `position` where there is one observation, else with the observation's name before it. quantity, observation:
    what of which. block: components of one reading: residuals are judged by the norm over ``block`` consecutive
    columns. floor: noise of data that have none: rounding. alike: noise that goes with one unit of noise of the
    observation's first group, roughly.
    """

    name: str
    unit: Unit
    columns: tuple[int, ...]
    block: int
    floor: float
    alike: float = 1.0
    quantity: str = ""
    observation: str = ""


@dataclass(frozen=True, slots=True)
class Part:
    """What one observation adds.

    readings, components: its columns in z and in the residual. errors: its place in the vector of errors.
    residual: (q, x, setup, z) -> r and J of its own z alone, shapes (m,) and (m, n); of many points in one piece in
        stages, which say all else too.
    margins: (q, x, setup) -> by how much each feature can be read, shape (features * limits,); None without limits.
    contact: (q, x, setup) -> c, by how much a posture misses a constraint, shape (m,), mm, dc/dq, shape (m, dof), and
        the point that touches in the constraint's frame, shape (3,), mm; None of what reads.
    """

    observation: Observation
    readings: slice
    components: slice
    errors: slice
    attitudes: slice
    residual: ca.Function | StagedKernel
    margins: ca.Function | None = None
    contact: ca.Function | None = None

    @property
    def staged(self) -> StagedKernel | None:
        return self.residual if isinstance(self.residual, StagedKernel) else None

    @property
    def features(self) -> int:
        return max(len(self.observation.features), 1)

    @property
    def size(self) -> int:
        """Residual components of a posture."""
        return int(self.components.stop - self.components.start)

    def seen(self, z: Array) -> NDArray[np.bool_]:
        """Which components of the residual were measured, shape (N, m), from all readings (N, nz)."""
        there = np.isfinite(z[:, self.readings])
        if self.observation.instrument.componentwise:
            return there
        whole = there.reshape(len(z), self.features, -1).all(axis=2)
        return np.repeat(whole, (self.components.stop - self.components.start) // self.features, axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Expressions:
    """What the parts together say, symbolically, written down when it is asked for; those in stages say it themselves.

    state: q, x and setup. z: all readings. readings: as they would be given. planned: J at zero residual. judged: what
    is judged. points: of the robot that are measured, each with its Jacobian.
    """

    state: Mapping[str, SX]
    z: SX
    readings: Callable[[], SX]
    planned: Callable[[], SX]
    judged: SX
    points: Callable[[], tuple[SX, SX]]


@dataclass(frozen=True, eq=False)
class Measurement:
    """Any number of observations of one robot; made by `symcal.model.observe.observe`.

    The functions are of all parts but those in stages: `symcal.model.assembled` has them for everything. They are made
    when they are first asked for: an identification needs few of them.

    points_called: what the points of the setup are called as parameters.
    growth: slope of the growth of all lengths by the errors, shape (n,), see `symcal.model.growth`; zero where nothing
        asks for it.
    known: what is known between things; values: (q, x, setup) -> r and J of each, over its noise, whatever q is.
    """

    chain: Chain
    parts: tuple[Part, ...]
    groups: tuple[Group, ...]
    points_called: tuple[str, ...]
    expressions: Expressions
    growth: Array = field(default_factory=lambda: np.zeros(0))
    known: tuple[Observation, ...] = ()
    values: tuple[ca.Function, ...] = ()

    @cached_property
    def predict(self) -> ca.Function:
        """(q, x, setup) -> h, shape (nz,), as the instruments would give it, one observation after the other."""
        return self._function("predict", {"h": self.expressions.readings()})

    @cached_property
    def jacobian(self) -> ca.Function:
        """(q, x, setup) -> J at zero residual, shape (m, n): the information of a pose that is yet to be measured."""
        return self._function("planned", {"J": self.expressions.planned()})

    @cached_property
    def accuracy(self) -> ca.Function:
        """(q, x, setup, z) -> e: what is judged, by observation: of an instrument that gives points the tool's error in
        world (mm), then of its attitude (rad); of another one what it says of itself."""
        return self._function("accuracy", {"e": self.expressions.judged}, {"z": self.expressions.z})

    @cached_property
    def points(self) -> ca.Function:
        """(q, x, setup) -> the points of the robot that are measured, in world, shape (3 k,), mm, and their Jacobian,
        shape (3 k, n)."""
        return self._function("points", dict(zip(("p", "J"), self.expressions.points(), strict=True)))

    def _function(self, name: str, outputs: dict[str, SX], more: Mapping[str, SX] | None = None) -> ca.Function:
        return kinematics.function(name, {**self.expressions.state, **(more or {})}, outputs)

    def known_rows(self, x: Array, setup: Setup) -> Iterator[tuple[Observation, Array, Array]]:
        """Every known value with its residual over its noise, shape (k,), and the slopes of that, shape (k, n)."""
        still = np.zeros(self.chain.robot.dof)  # whatever the posture
        for observation, value in zip(self.known, self.values, strict=True):
            r, jacobian = value(still, x, setup.vector)
            yield observation, np.asarray(r).ravel(), np.asarray(jacobian)

    @property
    def parameters(self) -> ParameterSet:
        return self.chain.parameters

    @property
    def rows(self) -> int:
        """Residual components per pose."""
        return int(self.parts[-1].components.stop)

    @property
    def observations(self) -> tuple[Observation, ...]:
        return tuple(part.observation for part in self.parts)

    @property
    def stated_noise(self) -> dict[str, float]:
        """What is stated of the noise, by group: mm, rad or px."""
        stated = {o.of: o.noise for o in self.observations}
        return {g.name: stated[g.observation][g.quantity] for g in self.groups if g.quantity in stated[g.observation]}

    @property
    def residual(self) -> ca.Function | StagedKernel:
        """Of the only observation."""
        (part,) = self.parts
        return part.residual

    @property
    def sees_length(self) -> bool:
        """Whether any reading of a posture changes when all lengths grow by the same share; a stroke is a length."""
        strokes = not all(joint.revolute for joint in self.chain.robot.joints)
        return strokes or any(o.instrument.sees_length for o in self.observations)

    @property
    def knows_length(self) -> bool:
        """Whether a length is known that no posture reads: a value, a place, a point off its frame's origin."""
        ends = [place for o in self.observations for place in (o.at, o.target.at)]
        points = [xyz for o in self.observations for xyz in o.target.points.values() if not o.target.unknown]
        placed = any(place.frame is not None and not place.unknown for place in ends)
        return bool(self.known) or placed or any(xyz is not None and any(xyz) for xyz in points)

    @property
    def adrift(self) -> bool:
        """Nothing but the instruments says where the world is: errors are meant after one rigid alignment."""
        own = [o for o in self.observations if o.reports == "target"]
        loose = [o.target.at.unknown if o.riding else o.at.unknown and not o.at.moves for o in own]
        return bool(loose) and all(loose)

    def per_component(self, values: Mapping[str, float]) -> Array:
        """A value per group spread over the residual components, shape (m,)."""
        out = np.empty(self.rows)
        for group in self.groups:
            out[list(group.columns)] = values[group.name]
        return out

    def per_unit(self, values: Mapping[str, float]) -> Array:
        """A value per unit (mm, rad, px) spread over the residual components, shape (m,)."""
        return self.per_component({group.name: values[group.unit] for group in self.groups})
