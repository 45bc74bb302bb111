"""Calibrate a robot from measurements: data and what they are of in, a calibration out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from symcal.calibration.calibrate import Calibration, baseline_model
from symcal.calibration.extend import calibrate_extended, shrinking, with_directions
from symcal.calibration.judgement import decide_alone, with_decision
from symcal.data.dataset import Dataset, merged
from symcal.data.measurement_file import load_measurements
from symcal.errors import InputError
from symcal.fit.estimation import Options
from symcal.model.model import build_model
from symcal.model.observation import Observation
from symcal.model.task import Task
from symcal.robot.robot import Robot


def identify(
    robot: Robot,
    data: Dataset | Sequence[Observation],
    task: Task | None = None,
    options: Options | None = None,
    *,
    base: Literal["known", "unknown"] = "known",
    tool: Literal["known", "unknown"] = "known",
    extend: str | Sequence[str] = (),
) -> Calibration:
    """Calibrate a robot from measurements; only poses of the `train` split are used.

    Whether the calibration is worth anything is decided by the test poses of the data, and where there are none by the
    training poses, left out in turn of the linearised fit (`symcal.calibration.left_out`). The decision goes with the
    robot and its file, and to every export.

    Args:
        data: measurements and the task that they belong to, or observations with their ``data``. base, tool: whether
            the robot's own frames are to be found, where observations are given. extend: groups of joint terms that
            the data may ask for (`symcal.calibration.candidates.GROUPS`), or `auto`; what was found is in
            `Calibration.extension`.
    Raises:
        InputError: names that the model does not have, files that cannot be read. RefusedError: too few poses, or data
        that the robot cannot have produced.
    """
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
