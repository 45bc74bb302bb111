"""Calibrate a robot from measurements: data and what they are of in, a calibration out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, overload

from numpy.typing import ArrayLike

from symcal.calibration.arrays import ArraysFit, identify_arrays
from symcal.calibration.calibrate import Calibration, baseline_model
from symcal.calibration.extend import calibrate_extended, shrinking, with_directions
from symcal.calibration.judgement import decide_alone, with_decision
from symcal.data.dataset import Dataset, merged
from symcal.data.measurement_file import load_measurements
from symcal.errors import InputError
from symcal.fit.estimation import Options
from symcal.fit.many import ManyFits
from symcal.model.measurement import Setup
from symcal.model.model import Model, build_model
from symcal.model.observation import Observation
from symcal.model.task import Task
from symcal.robot.robot import Robot


@overload
def identify(
    robot: Robot,
    data: Dataset | Sequence[Observation],
    task: Task | None = None,
    options: Options | None = None,
    *,
    base: Literal["known", "unknown"] = "known",
    tool: Literal["known", "unknown"] = "known",
    extend: str | Sequence[str] = (),
) -> Calibration: ...


@overload
def identify(
    robot: Model,
    data: ArrayLike,
    task: ArrayLike,
    *,
    sigma: ArrayLike,
    free: tuple[str, ...] | None = None,
    start: ArrayLike | None = None,
    setup: Setup | ArrayLike | None = None,
) -> ArraysFit | ManyFits: ...


def identify(
    robot: Robot | Model,
    data: Dataset | Sequence[Observation] | ArrayLike,
    task: Task | ArrayLike | None = None,
    options: Options | None = None,
    *,
    base: Literal["known", "unknown"] = "known",
    tool: Literal["known", "unknown"] = "known",
    extend: str | Sequence[str] = (),
    sigma: ArrayLike | None = None,
    free: tuple[str, ...] | None = None,
    start: ArrayLike | None = None,
    setup: Setup | ArrayLike | None = None,
) -> Calibration | ArraysFit | ManyFits:
    """Calibrate a robot from measurements; only poses of the `train` split are used.

    Whether the calibration is worth anything is decided by the test poses of the data, and where there are none by the
    training poses, left out in turn of the linearised fit (`symcal.calibration.left_out`). The decision goes with the
    robot and its file, and to every export.

    `identify(model, q, z, sigma=...)` is the bare estimate, for programs that make thousands of them: a model that was
    built, joint readings (N, dof) and readings (N, nz), or of R sets (R, N, nz), with known noise; as of
    `symcal.fit.many.fit_many`. It searches for no mistakes and judges nothing: that is what a robot and a dataset are
    for.

    Args:
        data: measurements and the task that they belong to, or observations with their ``data``. base, tool: whether
            the robot's own frames are to be found, where observations are given. extend: groups of joint terms that
            the data may ask for (`symcal.calibration.candidates.GROUPS`), or `auto`; what was found is in
            `Calibration.extension`. sigma, free, start, setup: of arrays alone.
    Raises:
        InputError: names that the model does not have, files that cannot be read. RefusedError: too few poses, or data
        that the robot cannot have produced.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> task, rng = sc.Task.of("position"), np.random.default_rng(1)
        >>> q = rng.uniform(robot.lower, robot.upper, (40, robot.dof))
        >>> data = sc.simulate(sc.build_model(robot, task), {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)
        >>> calibration = sc.identify(robot, data, task)
        >>> calibration.after.identifiability.rank, len(calibration.after.free)
        (11, 15)
    """
    if isinstance(robot, Model):
        if sigma is None:
            raise InputError("arrays need the standard deviation of their noise", key="sigma")
        if task is None or isinstance(task, Task):
            raise InputError("a model needs joint readings and readings as arrays", key="z")
        return identify_arrays(robot, data, task, sigma, free=free, start=start, setup=setup)  # type: ignore[arg-type]
    return _calibrated(robot, data, task, options, base, tool, extend)  # type: ignore[arg-type]


def _calibrated(
    robot: Robot,
    data: Dataset | Sequence[Observation],
    task: Task | None,
    options: Options | None,
    base: Literal["known", "unknown"],
    tool: Literal["known", "unknown"],
    extend: str | Sequence[str],
) -> Calibration:
    for value, key in ((base, "base"), (tool, "tool")):
        if value not in ("known", "unknown"):
            raise InputError("not one of the allowed values", key=key, found=value, allowed=("known", "unknown"))
    if not isinstance(data, Dataset):
        if task is not None:
            raise InputError("observations with their data are the task: leave 'task' out", key="task")
        task = Task(tuple(data), base == "unknown", tool == "unknown")
        data = _gathered(robot, task.observations)
    if task is None:
        raise InputError("say what was measured: a task with the data, or observations with their data", key="task")
    model = build_model(robot, task)
    options = options or Options()
    sigma = {**model.measurement.stated_noise, **options.sigma}
    options = replace(options, sigma=sigma)
    groups = (extend,) if isinstance(extend, str) else tuple(extend)
    data = with_directions(data, robot, groups)
    found = calibrate_extended(model, baseline_model(model), data, options, groups)
    return with_decision(found, decide_alone(found, data, shrinking(found, options)))


def _gathered(robot: Robot, observations: Sequence[Observation]) -> Dataset:
    """The data of several observations as one."""
    sets = []
    for o in observations:
        if o.data is None:
            raise InputError("this observation has no data", key=o.name)
        own = o.data
        if not isinstance(own, Dataset):
            own = load_measurements(own, robot, o.instrument, point_names=o.features)
        sets.append(replace(own, of=(replace(own.only, name=o.name),)))
    return merged(sets, [o.session for o in observations])
