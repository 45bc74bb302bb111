r"""Instruments read targets: the symbolic measurement of any number of observations of one robot.

With T_world_instrument = (R_i, o_i), a feature of the target at w in world with axes R_t, and the screws of every
parameter of both,

    R = R_i^T R_t,   p = R_i^T (w - o_i),      omega = R_i^T (omega_t - omega_i),   v = R_i^T (v_t(w) - v_i(w))

so the instrument alone says what is read, and how that changes with a twist of the feature; the Jacobian is the chain
rule. A point's own coordinates move it by the columns of R_t. Where data hold the instrument's pose in the target's
frame the two change roles. Residuals of constraints are taken per growth of the arm, r / g, see
`symcal.instruments.constraint`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from symcal import kinematics
from symcal.instruments import Instrument
from symcal.kinematics import Chain
from symcal.model.facing import limits_of, margins_of
from symcal.model.measurement import Expressions, Group, Measurement, Part
from symcal.model.observation import Observation
from symcal.model.staged_kernel import StagedKernel, staged_kernel
from symcal.model.stages import stages
from symcal.model.symbols import Feature, Symbols

SX = ca.SX


def observe(chain: Chain, *observations: Observation, values: tuple[Observation, ...] = ()) -> Measurement:
    """The measurement of observations: z holds one reading after another, by observation and feature.

    Args:
        values: what is known between things that do not move against each other.
    Raises:
        InputError: a place on a link that does not exist.
    """
    scene = Symbols.of(chain, (*observations, *values))
    state = {"q": chain.q, "x": chain.x, "setup": scene.setup}
    z: list[SX] = []
    read: list[tuple[Observation, Feature]] = []
    readings = components = errors = 0
    parts: list[Part] = []
    groups: list[Group] = []
    everything: list[SX] = []
    for i, observation in enumerate(observations):
        kind, own = observation.instrument, _Gathered()
        for feature in () if observation.staged else scene.features(observation):
            own.add(observation, feature, scene.growth)
        read += [(observation, each) for each in own.features]
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
        z += own.z
        readings, components, errors = readings + width, components + m, errors + judged + turned
    n = len(chain.parameters)

    def points() -> tuple[SX, SX]:
        where = scene.robot_points(observations)
        return ca.vertcat(*(p for p, _ in where)), ca.vertcat(*(j for _, j in where))

    return Measurement(
        chain=chain,
        parts=tuple(parts),
        groups=_together(groups),
        points_called=tuple(scene.coordinates),
        expressions=Expressions(
            state,
            z=_stacked(z),
            readings=lambda: _stacked([_reading(*each) for each in read]),
            planned=lambda: _stacked([_planned(*each, scene.growth) for each in read], n),
            judged=_stacked(everything),
            points=points,
        ),
        growth=scene.slope,
        known=values,
        values=tuple(_value(scene, f"v{i}", observation, state) for i, observation in enumerate(values)),
    )


def _reading(observation: Observation, feature: Feature) -> SX:
    return observation.instrument.predict(feature.rotation, feature.point, feature.own)


def _planned(observation: Observation, feature: Feature, growth: tuple[SX, SX]) -> SX:
    """Slopes at a residual of zero."""
    kind = observation.instrument
    slopes = _slopes(kind, feature, None)
    return slopes / growth[0] if kind.constrains else slopes


def _slopes(kind: Instrument, feature: Feature, reading: SX | None) -> SX:
    """Slopes of a residual by all parameters, without the growth."""
    by_twist, by_own = kind.slopes(feature.rotation, feature.point, reading, feature.own)
    jacobian = by_twist @ feature.twist
    for i, column in feature.by_own.items():
        jacobian[:, column] = by_own[:, i]
    return jacobian


def _contact(name: str, state: dict[str, SX], observation: Observation, own: _Gathered) -> ca.Function:
    """How far a posture is from a constraint, how that changes with the joints, and where the point is."""
    c = ca.vertcat(*(_reading(observation, feature) for feature in own.features))
    points = ca.vertcat(*(feature.point for feature in own.features))
    return kinematics.function(name, state, {"c": c, "G": ca.jacobian(c, state["q"]), "p": points})


def _value(scene: Symbols, name: str, observation: Observation, state: dict[str, SX]) -> ca.Function:
    """(q, x, setup) -> residual of a known value over its noise, and its Jacobian; q is of no account."""
    assert observation.value is not None
    kind, rows = observation.instrument, _Gathered()
    for feature in scene.features(observation):
        rows.add(observation, feature, None)
    sigma = np.concatenate([np.full(q.size, observation.noise[q.noise]) for q in kind.quantities])
    z, given = ca.vertcat(*rows.z), ca.DM(observation.value)
    weighted = {"r": ca.vertcat(*rows.residuals) / sigma, "J": ca.diag(1 / sigma) @ ca.vertcat(*rows.jacobians)}
    return kinematics.function(name, state, {key: ca.substitute(each, z, given) for key, each in weighted.items()})


def _functions(
    scene: Symbols, state: dict[str, SX], observation: Observation, own: _Gathered, name: str
) -> tuple[ca.Function | StagedKernel, ca.Function | None, ca.Function | None]:
    """Residuals of an observation, its margins unless they are in stages too, and what its postures must lie on."""
    if observation.staged:
        numbers, by_own = scene.own_numbers(observation)
        return staged_kernel(stages(state, observation, *scene.ends(observation), numbers, by_own)), None, None
    residual = kinematics.function(
        f"{name}_residual",
        state | {"z": ca.vertcat(*own.z)},
        {"r": ca.vertcat(*own.residuals), "J": ca.vertcat(*own.jacobians)},
    )
    limits, constrains = limits_of(observation), observation.instrument.constrains
    margins = None
    if limits:
        each = (margins_of(observation, at.rotation, at.point, at.own) for at in own.features)
        margins = kinematics.function(f"{name}_margins", state, {"m": ca.vertcat(*each)})
    return residual, margins, _contact(f"{name}_contact", state, observation, own) if constrains else None


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


@dataclass(slots=True)
class _Gathered:
    """What is gathered feature by feature; lives only inside `observe`."""

    features: list[Feature] = field(default_factory=list)
    z: list[SX] = field(default_factory=list)
    residuals: list[SX] = field(default_factory=list)
    jacobians: list[SX] = field(default_factory=list)
    errors: list[SX] = field(default_factory=list)
    attitudes: list[SX] = field(default_factory=list)

    def add(self, observation: Observation, feature: Feature, growth: tuple[SX, SX] | None) -> None:
        """Args: growth: g and dg/dx, shape (1, n), that residuals of constraints are taken by."""
        kind, at = observation.instrument, (feature.rotation, feature.point)
        reading = SX.sym("z", len(kind.columns))
        residual, jacobian = kind.residual(*at, reading, feature.own), _slopes(kind, feature, reading)
        if kind.constrains and growth is not None:
            share, slope = growth
            residual = residual / share
            jacobian = jacobian / share - residual @ slope / share
        riding = observation.riding and observation.reports == "target"
        shift, attitude = kind.miss(*at, reading, feature.own, riding=riding)
        self.features.append(feature)
        self.z.append(reading)
        self.residuals.append(residual)
        self.jacobians.append(jacobian)
        self.errors.append(feature.to_world @ shift if kind.judged_in_world else shift)
        self.attitudes.append(attitude)
