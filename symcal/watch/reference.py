"""What a calibrated robot records, as a check needs it: how it was measured, how well it is known, what may change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.calibration.again import as_before, recorded, recorded_noise
from symcal.calibration.record import recorded_task
from symcal.data.dataset import Dataset
from symcal.errors import InputError, RefusedError
from symcal.fit.noise import known_sigma
from symcal.fit.residual_rows import rows_of
from symcal.model.model import Model, build_model
from symcal.model.observation import Observation
from symcal.model.task import Task
from symcal.parameters import SCALE, frame_names, zero_name
from symcal.robot.robot import Link, Robot

Array = NDArray[np.float64]

BASE, TOOL, REST = "base", "tool", "rest"
"""What hypotheses about frames and the sum of squares are called; those about joints have the joints' names."""

_NO_COVARIANCE = -1e-6  # least eigenvalue of a correlation matrix that is rounding


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """One thing that may have changed.

    parameters: the numbers of it, in `Reference.changed`. scales: what is plausible of each, in the unit of each.
    joint: its number, from one; None of frames.
    """

    name: str
    parameters: tuple[str, ...]
    scales: tuple[float, ...]
    units: tuple[str, ...]
    joint: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """A calibration that is to be checked; made by `reference_of`.

    observation: what reads. before, x: the model of the calibration, and the recorded errors of its n parameters.
    root: L, shape (n, l), L L^T their covariance. changed: the calibrated robot with everything free that may change.
    noise: of every group, mm, rad or px; dof: degrees of freedom with which it is known.
    """

    robot: Robot
    observation: Observation
    before: Model
    x: Array
    root: Array
    changed: Model
    hypotheses: tuple[Hypothesis, ...]
    noise: Mapping[str, float]
    dof: float

    @property
    def joints(self) -> tuple[Hypothesis, ...]:
        return tuple(h for h in self.hypotheses if h.joint is not None)

    def index(self, hypothesis: Hypothesis) -> NDArray[np.intp]:
        """Its columns in the slopes of `changed`."""
        return self.changed.parameters.indices(hypothesis.parameters)

    def named(self, name: str) -> Hypothesis:
        return next(h for h in self.hypotheses if h.name == name)


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """Readings about some values of what may change.

    r: model minus measured, shape (k,). slopes: by the parameters of `Reference.changed`, shape (k, c). reference: by
    those of the calibration, shape (k, n). spread: standard deviation of the noise, shape (k,). pose: of each, (k,).
    """

    r: Array
    slopes: Array
    reference: Array
    spread: Array
    pose: NDArray[np.intp]


def reference_of(robot: Robot, own: Sequence[Observation], file: Path) -> Reference:
    """What a check of a calibrated robot needs.

    Args:
        own: what measures, as recorded after the calibration: by session, the first stands for all.
    Raises:
        InputError: the file has no covariance. RefusedError: too little is recorded, in a sentence.
    """
    assert robot.record is not None
    provenance = robot.record.provenance
    chosen = own[0]
    task = recorded_task(provenance, "before", file)
    before_task = task.observed([next(o for o in task.observations if o.name == chosen.name)])
    provenance = recorded(robot, before_task)
    before = as_before(robot, before_task, provenance)
    names = before.parameters.names
    _check_numbers(robot, chosen, names)
    noise, stated = recorded_noise(before, provenance)
    if set(noise) != {group.name for group in before.measurement.groups}:
        raise RefusedError("the calibration does not record the noise of these measurements: identify again")
    estimated = bool(set(noise) - set(stated))
    changed = build_model(_with_offsets(replace(robot, record=None)), _loosened(chosen))
    return Reference(
        robot=robot,
        observation=chosen,
        before=before,
        x=before.parameters.vector({name: float(robot.record.errors[name]) for name in names}),
        root=_root(robot, names, file),
        changed=changed,
        hypotheses=_hypotheses(changed),
        noise=noise,
        dof=float(provenance["dof"]) if estimated else np.inf,
    )


def _check_numbers(robot: Robot, o: Observation, names: Sequence[str]) -> None:
    """Refuse an instrument whose own numbers were found: what is known of them is not carried into a check."""
    assert robot.record is not None
    own = {name for name in o.names if (robot.record.sigmas.get(name) or 0.0) > 0} - set(names)
    if own:
        raise RefusedError(
            f"numbers of '{o.name}' itself were found in the calibration ({', '.join(sorted(own))}): how well they are "
            "known is not carried into a check"
        )


def _root(robot: Robot, names: Sequence[str], file: Path) -> Array:
    assert robot.record is not None
    place = {name: i for i, name in enumerate(robot.record.errors)}
    index = [place[name] for name in names]
    covariance = np.asarray(robot.record.covariance)[np.ix_(index, index)]
    variance = np.diag(covariance)
    key = "calibration.covariance"
    if not np.isfinite(covariance).all() or not (variance > 0).any():
        message = "the calibration has no covariance: how well it is known decides what a check can tell"
        raise InputError(message, file=file, key=key)
    sigma = np.sqrt(np.maximum(variance, 0.0))
    kept = np.flatnonzero(sigma > 0)
    unit = covariance[np.ix_(kept, kept)] / np.outer(sigma[kept], sigma[kept])
    size, axes = np.linalg.eigh((unit + unit.T) / 2)
    if size[0] < _NO_COVARIANCE:
        raise InputError("this is no covariance: was it changed by hand?", file=file, key=key)
    root = np.zeros((len(names), len(kept)))
    root[kept] = sigma[kept, None] * axes * np.sqrt(np.maximum(size, 0.0))
    return root


def _with_offsets(robot: Robot) -> Robot:
    """The robot with a zero offset at every joint: one that lists none has none, until it changes."""
    kinds = ["theta" if joint.revolute else "d" for joint in robot.joints]
    links = [
        Link(link.joint, {kind: 0.0} | dict(link.parameters)) for link, kind in zip(robot.links, kinds, strict=True)
    ]
    return replace(robot, links=tuple(links))


def _loosened(o: Observation) -> Task:
    """Everything known, but for the base and what is carried."""
    if o.at.moves:  # an instrument in the hand
        tool, carried = o.at.on == TOOL, replace(o, at=replace(o.at, unknown=o.at.on != TOOL))
    else:
        on = o.target.at.on
        target = replace(o.target, at=replace(o.target.at, unknown=on != TOOL and o.target.at.moves))
        tool, carried = on == TOOL, replace(o, target=target)
    return Task((carried,), base=True, tool=tool)


def _hypotheses(model: Model) -> tuple[Hypothesis, ...]:
    names = model.parameters.names
    frames = frame_names(BASE)
    base = tuple(name for name in frames if name in names)
    carried = tuple(name for name in model.placement if name not in frames)
    units: dict[str, str] = dict(zip(names, model.parameters.units, strict=True))
    known: list[tuple[str, tuple[str, ...], int | None]] = [(BASE, base, None), (TOOL, carried, None)]
    taken = [BASE, TOOL, REST, *(joint.name for joint in model.robot.joints)]
    for i, joint in enumerate(model.robot.joints, start=1):
        called = joint.name if taken.count(joint.name) == 1 else f"joint_{i}"
        known.append((called, (zero_name(joint.revolute, i),), i))
    return tuple(
        Hypothesis(name, own, tuple(SCALE[units[each]] for each in own), tuple(units[each] for each in own), number)
        for name, own, number in known
        if own
    )


def linear_at(reference: Reference, data: Dataset, y: Array, base: Array | None = None) -> Linear:
    """Readings about values y of what may change, shape (c,).

    Args:
        base: where the base (and y) is taken from, shape (4, 4); where it was calibrated when None.
    """
    changed = reference.changed
    if base is not None:
        changed = replace(changed, setup=replace(changed.setup, base=base))
    rows = rows_of(changed.measurement, data, changed.setup, changed.residuals).decorrelated()
    r, slopes = rows(y)
    before, x = reference.before, reference.x
    own = frame_names(BASE)
    motion = y[[i for i, name in enumerate(changed.parameters.names) if name in own]]
    if base is not None or motion.any():
        moved = [name in own for name in before.parameters.names]
        x = np.where(moved, 0.0, x)
        before = replace(before, setup=replace(before.setup, base=carried_out(changed.setup.base, motion)))
    known = rows_of(before.measurement, data, before.setup, before.residuals).decorrelated()(x)[1]
    spread = known_sigma(rows, reference.noise)
    kept = rows.seen
    poses = np.broadcast_to(np.arange(len(data))[:, None], kept.shape)
    return Linear(r[kept], slopes[kept], known[kept], spread[kept], poses[kept])


def carried_out(frame: Array, increment: Array) -> Array:
    """A frame with its increments x to rz carried out, shape (4, 4)."""
    return np.asarray(frame @ spatial.transform(spatial.vector_matrix(increment[3:]), increment[:3]))
