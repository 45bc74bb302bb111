"""From a dataset to a calibrated robot: registration, the baselines, the identification, and the robot it leaves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from symcal import measurements, uncertainty
from symcal.dataset import Dataset
from symcal.errors import InputError, RefusedError
from symcal.estimation import Fit, Options, fit, residual_kernel, rows_of
from symcal.kernels.batch import BatchFunction, batch_function
from symcal.kinematics import chain, forward
from symcal.measurements import Measurement, Setup
from symcal.parameters import ParameterSet, parameter_set
from symcal.registration import Registration, hand_eye, register, virtual_points
from symcal.robot import Record, Robot
from symcal.spatial import inverse, pose_matrix

Array = NDArray[np.float64]
Part = Literal["base", "tool", "points"]


@dataclass(frozen=True, slots=True)
class Task:
    """What is measured on a robot and what is to be estimated.

    kind: `position` or `pose`; invert: pose data are T_tool_world (eye in hand). estimate: parts whose place is unknown.
    points: tool points in the tool frame by name, mm (position); coordinates of points to be estimated may be anything.
    fix: parameters to hold at nominal. scales, priors: by parameter name, mm or rad.
    """

    kind: Literal["position", "pose"]
    estimate: frozenset[Part] = frozenset()
    points: Mapping[str, tuple[float, float, float]] = field(default_factory=lambda: {"P": (0.0, 0.0, 0.0)})
    invert: bool = False
    fix: tuple[str, ...] = ()
    scales: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, float] = field(default_factory=dict)

    @property
    def point_names(self) -> tuple[str, ...]:
        return tuple(self.points) if self.kind == "position" else ()

    @property
    def tool(self) -> Literal["frame", "position", "points"] | None:
        """What of the tool is estimated. One point alone does not see the tool's orientation."""
        if "points" in self.estimate:
            return "points"
        if "tool" in self.estimate:
            return "frame" if self.kind == "pose" or len(self.points) > 1 else "position"
        return None


@dataclass(frozen=True, slots=True)
class Model:
    """The compiled measurement model of a task; made once, used for every fit."""

    task: Task
    robot: Robot
    measurement: Measurement
    residual: BatchFunction
    accuracy: BatchFunction
    jacobian: BatchFunction
    flange: BatchFunction
    setup: Setup

    @property
    def parameters(self) -> ParameterSet:
        return self.measurement.parameters

    @property
    def kinematic(self) -> tuple[str, ...]:
        """Link parameters that may be identified."""
        return tuple(name for name in self.robot.parameters if name not in self.task.fix)

    @property
    def offsets(self) -> tuple[str, ...]:
        """Zero offsets of the joints."""
        wanted = {f"{'theta' if j.revolute else 'd'}_{i}" for i, j in enumerate(self.robot.joints, start=1)}
        return tuple(name for name in self.kinematic if name in wanted)

    @property
    def placement(self) -> tuple[str, ...]:
        """Parameters of base, tool and points that are estimated."""
        return tuple(
            name for name in self.parameters.names if name not in self.robot.parameters and name not in self.task.fix
        )


@dataclass(frozen=True, slots=True)
class State:
    """A model with values for everything in it: what is needed to predict a measurement."""

    model: Model
    setup: Setup
    x: Array


@dataclass(frozen=True, slots=True)
class Calibration:
    """An identification: fits of the same training data from poor to rich, and the robot that the last one makes.

    setup: the estimated frames fitted with nominal kinematics; the fits refer to it, so that unseen directions stay there.
    before: nominal kinematics with base and tool fitted, whether or not the task estimates them: the fair baseline. before_raw: nominal
    kinematics with the frames as given, where all are given. offsets: joint zeros and frames; after: everything identifiable.
    """

    model: Model
    setup: Setup
    before: State
    before_raw: State | None
    offsets: Fit
    after: Fit
    robot: Robot
    notes: tuple[str, ...] = ()

    @property
    def states(self) -> dict[str, State]:
        """What is compared, by the names of the results file."""
        raw = {} if self.before_raw is None else {"before_raw": self.before_raw}
        return raw | {
            "before": self.before,
            "offsets_only": State(self.model, self.setup, self.offsets.x),
            "after": State(self.model, self.setup, self.after.x),
        }


def build_model(robot: Robot, task: Task) -> Model:
    """Build and compile the symbolic model of a task.

    Raises:
        InputError: names in fix, scales or priors that the model does not have; parts that cannot be estimated together.
    """
    if "points" in task.estimate and "tool" in task.estimate:
        raise InputError(
            "'tool' and 'points' cannot both be estimated: moving the tool frame and moving all its points is the same",
            key="measurement.estimate",
        )
    if "points" in task.estimate and task.kind != "position":
        raise InputError("only position measurements have tool points to estimate", key="measurement.estimate")
    if task.invert and task.kind != "pose":
        raise InputError("only pose measurements can be inverted", key="measurement.invert")
    parameters = parameter_set(
        robot,
        base="base" in task.estimate,
        tool=None if task.tool in (None, "points") else task.tool,  # type: ignore[arg-type]
        points=task.point_names if task.tool == "points" else (),
    )
    for name in task.fix:
        if name not in parameters.names:
            raise InputError("no such parameter to fix", key="identification.fix", found=name, allowed=parameters.names)
    parameters = parameters.with_scales(task.scales).with_priors(task.priors)
    symbolic = chain(robot, parameters)
    if task.kind == "position":
        measurement = measurements.position(symbolic, task.point_names)
        points = np.array(list(task.points.values()), dtype=float).reshape(-1, 3)
    else:
        measurement = measurements.pose(symbolic, invert=task.invert)
        points = np.zeros((0, 3))
    return Model(
        task=task,
        robot=robot,
        measurement=measurement,
        residual=residual_kernel(measurement),
        accuracy=batch_function(measurement.accuracy, evaluations=0),
        jacobian=batch_function(measurement.jacobian, evaluations=0),
        flange=batch_function(forward(symbolic), evaluations=0),
        setup=Setup(robot.base, robot.tool, points),
    )


def identify(robot: Robot, data: Dataset, task: Task, options: Options | None = None) -> Calibration:
    """Calibrate a robot from measurements; only poses of the `train` split are used.

    Raises:
        InputError: names that the model does not have. RefusedError: too few poses, or data that the robot cannot have produced.
    """
    model = build_model(robot, task)
    return calibrate(model, baseline_model(model), data, options or Options())


def calibrate(model: Model, baseline: Model | None, data: Dataset, options: Options) -> Calibration:
    """`identify` with models that were built before (cross-validation, many draws).

    Args:
        baseline: from `baseline_model`.
    """
    train = data.part("train")
    if len(train) == 0:
        raise RefusedError("no pose is marked for training")
    setup = _place(model, train, options)
    rows = rows_of(model.measurement, train, setup, model.residual)
    offsets = fit(rows, (*model.offsets, *model.placement), options)
    after = fit(rows, (*model.kinematic, *model.placement), options)
    before = State(model, setup, np.zeros(len(model.parameters)))
    raw = None if model.placement else before
    if baseline is not None:
        before = State(baseline, _place(baseline, train, options), np.zeros(len(baseline.parameters)))
    notes = (*_plausibility(train, before), *_quality(model, train, after))
    return Calibration(model, setup, before, raw, offsets, after, calibrated_robot(model, after), notes)


def baseline_model(model: Model) -> Model | None:
    """The model whose frames are all estimated, for the baseline; None if that is the model itself."""
    tool: Part = "points" if "points" in model.task.estimate else "tool"
    estimate = frozenset[Part](("base", tool))
    if model.task.estimate == estimate:
        return None
    task = replace(model.task, estimate=estimate, fix=(), scales={}, priors={})
    return build_model(model.robot, task)


# ---------------------------------------------------------------------------------------------------------- registration


def _place(model: Model, data: Dataset, options: Options) -> Setup:
    """The nominal frames fitted to the data: closed forms for a few first guesses, then least squares on the frames alone."""
    task = model.task
    if not model.placement:
        return model.setup
    flange = _flange_in_base(model, data.q)
    tool_points, measured = model.setup.points, data.z
    starts: tuple[Registration, ...] = ()
    nominal = Registration(model.setup.base, model.setup.tool, tool_points, np.inf)
    if task.kind == "pose":
        poses = pose_matrix(data.z)
        poses = inverse(poses) if task.invert else poses
        nominal = replace(nominal, points=virtual_points(np.eye(4)[None])[0])
        if {"base", "tool"} <= task.estimate and len(data) >= 3:
            base, tool = hand_eye(flange, poses)
            starts = (replace(nominal, base=base, tool=tool),)
        targets = virtual_points(poses)
    else:
        targets = measured.reshape(len(data), -1, 3)
    guesses = register(flange, targets, nominal, base="base" in task.estimate, tool=task.tool, starts=starts)
    fits = []
    for guess in guesses:
        setup = Setup(guess.base, guess.tool, guess.points if task.kind == "position" else tool_points)
        fits.append(fit(rows_of(model.measurement, data, setup, model.residual), model.placement, options))
    best = min(fits, key=lambda f: _total(model, data, f))
    errors = model.parameters.mapping(best.x)
    return best.setup.moved(errors, model.measurement.point_names)


def _flange_in_base(model: Model, q: Array) -> Array:
    at_home = Setup(np.eye(4), np.eye(4)).vector
    pose, _, _ = model.flange(q, np.zeros(len(model.parameters)), at_home)
    return pose


def _total(model: Model, data: Dataset, candidate: Fit) -> float:
    """Squared residuals of a placement with poses seen as points, so that guesses are compared in one unit."""
    r, _ = rows_of(model.measurement, data, candidate.setup, model.residual)(candidate.x)
    return float(np.sum((r * model.measurement.per_component({"position": 1.0, "orientation": 200.0})) ** 2))


# -------------------------------------------------------------------------------------------------------------- warnings


def _plausibility(data: Dataset, before: State) -> tuple[str, ...]:
    """What the nominal robot with fitted frames says about units, joint order and signs."""
    model = before.model
    r, _ = rows_of(model.measurement, data, before.setup, model.residual)(before.x)
    position = r[:, list(model.measurement.groups[0].columns)].reshape(-1, 3)
    measured = (
        data.z[:, : position.size // len(data)].reshape(-1, 3) if model.task.kind == "position" else data.z[:, :3]
    )
    seen = np.isfinite(measured).all(axis=1)
    error = float(np.sqrt(np.mean(np.sum(position[seen] ** 2, axis=1))))
    spread = float(np.sqrt(np.mean(np.sum((measured[seen] - measured[seen].mean(axis=0)) ** 2, axis=1))))
    predicted = measured + position
    reach = float(np.sqrt(np.mean(np.sum((predicted[seen] - predicted[seen].mean(axis=0)) ** 2, axis=1))))
    if reach > 1.0 and spread > 0 and not 1 / 30 < spread / reach < 30:
        raise RefusedError(
            f"the measured points spread over {spread:.3g} mm, the robot's over {reach:.3g} mm: the measurements are not in the unit "
            "that their columns name"
        )
    if error > 0.1 * max(reach, 1e-9):
        return (
            f"nominal kinematics with fitted frames is off by {error:.4g} mm rms, {error / reach:.0%} of the measured spread: check the "
            "order, units and signs of the joint columns, and the robot file",
        )
    return ()


def _quality(model: Model, data: Dataset, after: Fit) -> tuple[str, ...]:
    notes = []
    if after.dof < 2 * after.identifiability.rank:
        notes.append(
            f"only {after.dof} degrees of freedom are left for {after.identifiability.rank} identified directions ({len(data)} poses): the errors "
            "on the training data say little about other poses; trust the held-out or cross-validated ones"
        )
    if not after.solution.status.converged:
        notes.append(f"the identification did not converge: {after.solution.message}")
    errors = model.parameters.mapping(after.x)
    large = [
        name
        for name in model.kinematic
        if abs(errors[name]) > 20 * model.parameters.items[model.parameters.index(name)].scale
    ]
    if large:
        notes.append(
            f"corrections of {', '.join(large)} are more than 20 times their plausible scale: check signs, units and zero positions, or "
            "give larger 'scales'"
        )
    if not after.estimated and after.dof > 0:
        factor = float(np.sqrt(after.chi_squared / after.dof))
        if factor > 1.5 or factor < 0.67:
            notes.append(
                f"residuals are {factor:.3g} times the stated noise: the noise is stated too {'small' if factor > 1 else 'large'}"
                + (", or the model lacks something" if factor > 1 else "")
            )
    return tuple(notes)


# ---------------------------------------------------------------------------------------------------------------- result


def calibrated_robot(model: Model, result: Fit) -> Robot:
    """The robot with its identified numbers, frames and covariance."""
    errors = model.parameters.mapping(result.x)
    kinematic = {name: errors[name] for name in model.robot.parameters}
    setup = result.setup.moved(errors, model.measurement.point_names)
    free = result.free
    sigma = dict.fromkeys(model.parameters.names)
    sigma |= dict(zip(free, uncertainty.sigmas(result.identifiability), strict=True))  # type: ignore[arg-type]
    full = np.zeros((len(model.parameters), len(model.parameters)))
    index = model.parameters.indices(free)
    full[np.ix_(index, index)] = uncertainty.covariance(result.identifiability)
    provenance: dict[str, Any] = {
        "measurement": {
            "type": model.task.kind,
            "invert": model.task.invert,
            "points_mm": {name: setup.points[k].tolist() for k, name in enumerate(model.measurement.point_names)},
        },
        "noise_sigma": {f"{g.name}_{g.unit}": result.sigmas.get(g.name) for g in model.measurement.groups},
        "rank": result.identifiability.rank,
        "dof": result.dof,
    }
    record = Record(
        errors=errors,
        sigmas=sigma,
        covariance=full,
        nominal_base=result.setup.base,
        nominal_tool=result.setup.tool,
        provenance=provenance,
    )
    return replace(model.robot.corrected(kinematic), base=setup.base, tool=setup.tool, record=record)
