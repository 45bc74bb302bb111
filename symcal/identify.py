"""From a dataset to a calibrated robot: registration, the baselines, the identification, and the robot it leaves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from symcal import uncertainty
from symcal.cautions import plausibility, quality
from symcal.dataset import Dataset
from symcal.errors import RefusedError
from symcal.estimation import Fit, Options, fit
from symcal.measurements import Setup
from symcal.model import Model, Part, State, Task, build_model
from symcal.registration import Registration, hand_eye, register, virtual_points
from symcal.robot import Record, Robot
from symcal.rows import rows_of
from symcal.spatial import inverse, pose_matrix

Array = NDArray[np.float64]

_BLAS = ThreadpoolController()


@dataclass(frozen=True, slots=True)
class Calibration:
    """An identification: fits of the same training data from poor to rich, and the robot that the last one makes.

    setup: the estimated frames fitted with nominal kinematics; the fits refer to it, so that unseen directions stay
        there.
    before: nominal kinematics with base and tool fitted, whether or not the task estimates them: the fair baseline.
        before_raw: nominal
    kinematics with the frames as given, where all are given. offsets: joint zeros and frames; after: everything
    identifiable.
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


def identify(robot: Robot, data: Dataset, task: Task, options: Options | None = None) -> Calibration:
    """Calibrate a robot from measurements; only poses of the `train` split are used.

    Raises:
        InputError: names that the model does not have. RefusedError: too few poses, or data that the robot cannot
        have produced.
    """
    model = build_model(robot, task)
    return calibrate(model, baseline_model(model), data, options or Options())


def calibrate(model: Model, baseline: Model | None, data: Dataset, options: Options) -> Calibration:
    """`identify` with models that were built before (cross-validation, many draws).

    Args:
        baseline: from `baseline_model`.
    """
    with _BLAS.limit(limits=1):  # small matrices: a second thread only costs
        return _calibrate(model, baseline, data, options)


def _calibrate(model: Model, baseline: Model | None, data: Dataset, options: Options) -> Calibration:
    train = data.part("train")
    if len(train) == 0:
        raise RefusedError("no pose is marked for training")
    setup = place(model, train, options)
    rows = rows_of(model.measurement, train, setup, model.residual)
    offsets = fit(rows, (*model.offsets, *model.placement), options)
    after = fit(rows, (*model.kinematic, *model.placement), options)
    before = State(model, setup, np.zeros(len(model.parameters)))
    raw = None if model.placement else before
    if baseline is not None:
        before = State(baseline, place(baseline, train, options), np.zeros(len(baseline.parameters)))
    notes = (*plausibility(train, before), *quality(model, train, after))
    return Calibration(model, setup, before, raw, offsets, after, calibrated_robot(model, after), notes)


def baseline_model(model: Model) -> Model | None:
    """The model whose frames are all estimated, for the baseline; None if that is the model itself."""
    tool: Part = "points" if "points" in model.task.estimate else "tool"
    estimate = frozenset[Part](("base", tool))
    if model.task.estimate == estimate:
        return None
    task = replace(model.task, estimate=estimate, fix=(), scales={}, priors={})
    return build_model(model.robot, task)


def place(model: Model, data: Dataset, options: Options) -> Setup:
    """The nominal frames fitted to the data.

    Closed forms for a few first guesses, then least squares on the frames alone.
    """
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


def calibrated_robot(model: Model, result: Fit) -> Robot:
    """The robot with its identified numbers, frames and covariance."""
    errors = model.parameters.mapping(result.x)
    kinematic = {name: errors[name] for name in model.robot.parameters}
    setup = result.setup.moved(errors, model.measurement.point_names)
    free = result.free
    sigma = dict.fromkeys(model.parameters.names)
    sigma |= dict(zip(free, uncertainty.sigmas(result.identifiability), strict=True))
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
