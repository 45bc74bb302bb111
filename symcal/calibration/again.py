"""A second calibration, from new measurements alone, compared with the recorded one.

The same parameters are identified with what was known beforehand of them in the first; only the noise is found anew.
What the first one knows is its recorded covariance: with that, and what was known beforehand, the law of the difference
is that of two halves (`symcal.fit.difference`). The recorded covariance has what the noise is not known by in it, so
that the law is a little wide.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.apart import POSTURES, Apart, disagree, region_of
from symcal.calibration.calibrate import one_thread
from symcal.data.dataset import Dataset
from symcal.errors import InputError, RefusedError
from symcal.fit.difference import Estimate, difference_of, estimate_of
from symcal.fit.estimation import Options
from symcal.fit.given_variances import estimate_given
from symcal.fit.half_rows import half_rows
from symcal.fit.noise import known_sigma, unknown_noise
from symcal.fit.redundancy import check_redundancy
from symcal.fit.residual_rows import rows_of
from symcal.fit.robust import LOSSES
from symcal.fit.variances import Variances
from symcal.fit.whitened import LINKS
from symcal.model.measurement import Setup
from symcal.model.model import Model, build_model
from symcal.model.observation import Observation
from symcal.model.task import Task
from symcal.parameters import frame_names
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

_NEEDED = (
    *("size_factor", "size_factors", "noise_sigma", "noise_estimated", "dof"),
    *("loss", "priors", "measurements", "learnt"),
)


@dataclass(frozen=True, slots=True)
class Again:
    """Both calibrations compared; poses: of the new one."""

    apart: Apart
    poses: int

    @property
    def p(self) -> float:
        """Probability of such a difference by chance."""
        return self.apart.compared.tested.p

    @property
    def agree(self) -> bool:
        """They differ by no more than is stated, or by chance."""
        return not disagree(self.apart.compared, 1)


def calibrated_again(
    robot: Robot, task: Task, data: Dataset, rng: np.random.Generator, now: Setup | None = None
) -> Again:
    """Calibrate from new measurements, and compare over the ranges of their joint readings.

    Args:
        robot: calibrated. task: of what measured, everything where it was before the calibration
            (`symcal.calibration.record.recorded_task`). data: all of it is used. rng: draws postures.
        now: where base and instruments stand now with the calibrated robot, if they were moved since: predictions are
            then compared after one rigid alignment.
    Raises:
        RefusedError: it cannot be done with these data or from what is recorded, in a sentence.
    """
    with one_thread():
        return _again(robot, task, data, rng, now)


def _again(robot: Robot, task: Task, data: Dataset, rng: np.random.Generator, now: Setup | None) -> Again:
    provenance = recorded(robot, task)
    assert robot.record is not None
    model = as_before(robot, task, provenance)
    names = model.parameters.names
    free = tuple(name for name in names if name in provenance["learnt"])
    first = model.parameters.vector({name: float(robot.record.errors[name]) for name in names})
    if now is not None:
        model, first = _moved(model, first, free, now)
    index = model.parameters.indices(free)
    rows = rows_of(model.measurement, data, model.setup, model.residuals)
    try:
        check_redundancy(rows, free, estimated=True)
    except RefusedError:
        few = f"{len(data)} poses are too few for a calibration of their own"
        raise RefusedError(f"{few}: they give no more equations than unknowns") from None
    factors = {LINKS: float(provenance["size_factor"]), **provenance["size_factors"]}
    sigmas, known = recorded_noise(model, provenance)
    given = Variances(sigmas, factors, rows.seen.astype(float))
    if not set(unknown_noise(rows, known_sigma(rows, known))) <= set(sigmas):
        raise RefusedError("the noise is not recorded")
    options = Options(loss=provenance["loss"], sigma=known)
    nothing = np.zeros(len(names))
    system, second, found = estimate_given(rows, free, options, given, first, nothing, noise_too=True)
    linear = half_rows(system, second, found, system.estimated)
    other = estimate_of(linear, np.ones(len(data), dtype=np.bool_))
    before = linear.known[:, :-1]
    dof = float(provenance["dof"]) if provenance["noise_estimated"] else np.inf
    law = difference_of(_estimate(robot, free, model.parameters.scales[index], before, dof), other, before)
    q = rng.uniform(data.q.min(axis=0), data.q.max(axis=0), (POSTURES, robot.dof))
    apart = region_of(model, model.setup, first, free, q, moved=now is not None).apart(law, first, second)
    if apart is None:
        raise RefusedError("the new poses leave too little to tell the noise by")
    return Again(apart, len(data))


def _moved(model: Model, first: Array, free: tuple[str, ...], now: Setup) -> tuple[Model, Array]:
    """The model where things stand now, and the recorded errors there.

    Raises:
        RefusedError: what moved was known when the robot was calibrated.
    """
    frames = {"base": now.base, **now.places}
    names = {name for name in model.parameters.names if name.rpartition("_")[0] in frames}
    if not set(frame_names("base")) <= set(free):
        raise RefusedError("the place of the base was known, or partly, when the robot was calibrated")
    first = np.where([name in names for name in model.parameters.names], 0.0, first)
    return replace(model, setup=replace(model.setup, base=now.base, places={**model.setup.places, **now.places})), first


def recorded(robot: Robot, task: Task) -> Mapping[str, Any]:
    """What is recorded.

    Raises:
        RefusedError: too little.
    """
    assert robot.record is not None
    provenance = robot.record.provenance
    if any(provenance.get(key) is None for key in _NEEDED) or any(
        not provenance["measurements"].get(o.name, {}).get("unknown") for o in task.observations
    ):
        raise RefusedError("the calibration was recorded by an earlier version: identify again to compare")
    if provenance.get("trouble"):
        raise RefusedError("the recorded identification did not converge")
    if provenance["loss"] not in LOSSES:
        raise RefusedError(f"the recorded loss is not known: {provenance['loss']}")
    if robot.remainder is not None:
        raise RefusedError("the calibrated robot has a smooth remainder")
    if any(o.instrument.camera is not None for o in task.observations):
        raise RefusedError("what is known of a camera beforehand is not recorded")
    return provenance


def as_before(robot: Robot, task: Task, provenance: Mapping[str, Any]) -> Model:
    """The model of the first calibration, for these observations.

    Raises:
        RefusedError: it cannot be had from what is recorded.
    """
    assert robot.record is not None
    learnt = set(provenance["learnt"])
    observations = [_loosened(o, provenance["measurements"][o.name]["unknown"]) for o in task.observations]
    nominal = robot.nominal()
    ends = [not learnt.isdisjoint(frame_names(frame)) for frame in ("base", "tool")]
    free = replace(task.observed(observations), base=ends[0], tool=ends[1], fix=(), scales={}, priors={})
    try:
        names = free.parameters(nominal).names
    except InputError as error:
        raise RefusedError(f"these measurements alone do not tell all of it: {error.message}") from None
    strange = [name for name in names if name not in robot.record.errors]
    if strange:
        raise RefusedError(f"the calibration does not record what was found of {', '.join(strange)}")
    priors = {name: float(sigma) for name, sigma in provenance["priors"].items() if name in names}
    fixed = tuple(name for name in names if name not in learnt)
    return build_model(nominal, replace(free, fix=fixed, priors=priors))


def _loosened(o: Observation, unknown: Mapping[str, Any]) -> Observation:
    """An observation with what was unknown of it.

    Raises:
        RefusedError: some of its points were, and others not.
    """
    points: Sequence[str] = unknown["points"]
    if points and set(points) != set(o.target.points):
        raise RefusedError(f"some points of '{o.target.name}' were known and others not")
    target = replace(o.target, unknown=bool(points), at=replace(o.target.at, unknown=bool(unknown["target"])))
    return replace(o, at=replace(o.at, unknown=bool(unknown["place"])), target=target)


def recorded_noise(model: Model, provenance: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, float]]:
    """Recorded noise by group, and of it what was stated.

    Where several instruments measured, the groups were called after these; of one alone they are not.
    """
    found: dict[str, float] = {}
    told: dict[str, float] = {}
    for group in model.measurement.groups:
        for name in (group.name, f"{group.observation} {group.name}"):
            own = provenance["noise_sigma"].get(f"{name}_{group.unit}")
            if own is None:
                continue
            found[group.name] = float(own)
            if name not in provenance["noise_estimated"]:
                told[group.name] = float(own)
            break
    return found, told


def _estimate(robot: Robot, free: tuple[str, ...], scales: Array, before: Array, dof: float) -> Estimate:
    """The recorded calibration in y = x / S: its covariance, and what the noise makes of that.

    With C = (N + P^T P)^-1 the noise makes C N C; N is taken as what is left of C^-1, without what rounding and the
    uncertainty of the variances make negative.
    """
    assert robot.record is not None
    place = {name: i for i, name in enumerate(robot.record.errors)}
    index = np.array([place[name] for name in free], dtype=np.intp)
    covariance = robot.record.covariance[np.ix_(index, index)] / np.outer(scales, scales)
    y = np.array([robot.record.errors[name] for name in free]) / scales
    told, axes = np.linalg.eigh(covariance - covariance @ (before.T @ before) @ covariance)
    scatter = (axes * np.maximum(told, 0.0)) @ axes.T
    return Estimate(y, covariance, scatter[None], [dof])
