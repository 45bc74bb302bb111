"""From a dataset to a calibrated robot: registration, the baselines, the identification, and the robot it leaves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from symcal.calibration.scene_record import scene_record
from symcal.calibration.warnings import plausibility, quality
from symcal.data.dataset import Dataset
from symcal.errors import InputError, RefusedError
from symcal.fit.estimation import Fit, Options, check_redundancy, fit
from symcal.fit.noise import known_sigma, unknown_noise
from symcal.fit.residual_rows import rows_of
from symcal.instruments import Setup
from symcal.model.model import Model, Part, State, Task, build_model
from symcal.placing.placement import place as place
from symcal.placing.placement import stated
from symcal.robot.robot import Record, Robot

Array = NDArray[np.float64]

_BLAS = ThreadpoolController()


@dataclass(frozen=True, slots=True)
class Calibration:
    """An identification: fits of the same training data from poor to rich, and the robot that the last one makes.

    setup: the estimated frames fitted with nominal kinematics; the fits refer to it.
    before: nominal kinematics with base and tool fitted, whether or not the task estimates them: the fair baseline.
    before_raw: nominal kinematics with the frames as given, where all are given.
    offsets: joint zeros and frames. after: all parameters that are not held.
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
    measured, wanted = (data.kind, data.point_names), (model.task.kind, model.measurement.point_names)
    if measured != wanted:
        raise InputError(f"the data are {_kind(*measured)}, the task asks for {_kind(*wanted)}")
    train = data.part("train")
    if len(train) == 0:
        raise RefusedError("no pose is marked for training")
    if model.task.scene is None:  # with a camera that nobody has placed yet the rows say nothing
        start = rows_of(model.measurement, train, model.setup, model.residual)
        estimated = unknown_noise(start, known_sigma(start, options.sigma))
        check_redundancy(start, (*model.kinematic, *model.placement), bool(estimated))
    setup = place(model, train, options)
    rows = rows_of(model.measurement, train, setup, model.residual)
    at = stated(model, setup)
    nominal = np.zeros(len(model.parameters))
    offsets = fit(rows, (*model.offsets, *model.placement), options, prior_mean=at, nested=(nominal,))
    after = fit(rows, (*model.kinematic, *model.placement), options, prior_mean=at, nested=(nominal, offsets.x))
    before = State(model, setup, nominal)
    raw = None if model.placement else before
    if baseline is not None:
        before = State(baseline, place(baseline, train, options), np.zeros(len(baseline.parameters)))
    notes = (*plausibility(train, before), *quality(model, train, after))
    return Calibration(model, setup, before, raw, offsets, after, calibrated_robot(model, after), notes)


def _kind(kind: str, points: tuple[str, ...]) -> str:
    return f"{kind} of {', '.join(points)}" if points else kind


def baseline_model(model: Model) -> Model | None:
    """The model whose frames are all estimated, for the baseline; None if that is the model itself."""
    tool: Part = "points" if "points" in model.task.estimate else "tool"
    estimate = frozenset[Part](("base" if model.task.scene is None else "camera", tool))
    if model.task.estimate - {"intrinsics"} == estimate:  # those keep their calibrated values at nominal kinematics
        return None
    task = replace(model.task, estimate=estimate, fix=(), scales={}, priors={})
    return build_model(model.robot, task)


def _scene(model: Model, nominal: Setup, found: Setup, errors: dict[str, float]) -> dict[str, Any]:
    record = scene_record(model, nominal, found, errors)
    return {"scene": record} if record else {}


def calibrated_robot(model: Model, result: Fit) -> Robot:
    """The robot with its identified numbers, frames and covariance."""
    errors = model.parameters.mapping(result.x)
    kinematic = {name: errors[name] for name in model.robot.parameters}
    setup = result.setup.moved(errors, model.measurement.point_names)
    free = result.free
    sigma: dict[str, float | None] = dict.fromkeys(model.parameters.names)
    sigma |= dict(zip(free, result.posterior.sigmas.tolist(), strict=True))
    full = np.zeros((len(model.parameters), len(model.parameters)))
    index = model.parameters.indices(free)
    full[np.ix_(index, index)] = result.posterior.covariance
    provenance: dict[str, Any] = {
        "measurement": {
            "type": model.task.kind,
            "invert": model.task.invert,
            "points_mm": {name: setup.points[k].tolist() for k, name in enumerate(model.measurement.point_names)},
            **_scene(model, result.setup, setup, errors),
        },
        "noise_sigma": {f"{g.name}_{g.unit}": result.sigmas.get(g.name) for g in model.measurement.groups},
        "rank": result.identifiability.rank,
        "dof": result.dof,
        "size_factor": result.factor,
        "learnt": dict(zip(free, result.posterior.learnt.tolist(), strict=True)),
        "trouble": result.trouble,
    }
    record = Record(
        errors=errors,
        sigmas=sigma,
        covariance=full,
        nominal_base=result.setup.base,
        nominal_tool=result.setup.tool,
        provenance=provenance,
    )
    scales = {p.name: p.scale for p in model.parameters.items if p.name in model.task.scales and not p.unknown}
    robot = replace(model.robot, scales={**model.robot.scales, **scales})
    return replace(robot.corrected(kinematic), base=setup.base, tool=setup.tool, record=record)
