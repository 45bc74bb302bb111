"""A calibrated robot judged on measurements that it has not seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from symcal.calibration import results
from symcal.calibration.evaluate import Errors, evaluate
from symcal.calibration.identify import place
from symcal.calibration.scene_record import recorded_scene
from symcal.data.measurement_file import load_measurements
from symcal.documents.table import read_table
from symcal.errors import InputError
from symcal.fit.estimation import Options
from symcal.instruments.registry import KINDS
from symcal.model.model import Model, Part, State, Task, build_model, pixels_task
from symcal.robot.robot import Robot, load_robot
from symcal.runs.folder import run_folder, write_json

_PARTS: tuple[Part, ...] = ("base", "tool", "points", "camera")


def validate_robot(
    calibrated: Path,
    data: Path,
    out: Path | None = None,
    refit: tuple[str, ...] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Errors of a calibrated robot on new measurements of the kind it was calibrated with.

    `before` is nominal kinematics with the frames that were fitted on the training data, `after` the calibrated robot.

    The file may have the canonical columns or those that the calibration was read from.

    Args:
        refit: frames to fit to the new data first, for both (the instrument or the tool was moved in between). What is
            then left says how well the kinematics carry over, not where the robot stands.
    Raises:
        InputError: a robot that was never calibrated, unreadable data, or parts that cannot be fitted.
    """
    robot = load_robot(calibrated)
    if robot.record is None:
        message = "this robot has no 'calibration': validate takes the calibrated.yaml of a run"
        raise InputError(message, file=calibrated)
    task = _task(robot, calibrated, refit, "after")
    progress("reading the measurements")
    layout = robot.record.provenance.get("layout", {})
    header = read_table(data, delimiter=layout.get("delimiter")).columns
    new = load_measurements(
        data,
        robot,
        task.kind,
        point_names=task.point_names,
        columns={canonical: name for canonical, name in layout.get("columns", {}).items() if name in header},
        delimiter=layout.get("delimiter"),
        decimal=layout.get("decimal", "."),
    )
    new = replace(new, split=("test",) * len(new))
    errors: dict[str, Errors] = {}
    for name, subject in (("before", robot.nominal()), ("after", robot)):
        progress(f"evaluating: {name}")
        model = build_model(subject, _task(robot, calibrated, refit, name))
        errors[name] = evaluate(_state(model, subject, new, refit), new)
    content = {
        **results.header(robot.name, f"Validation of {robot.name}", 0, (calibrated, data), Path.cwd()),
        "robot": results.robot_facts(robot),
        "measurement": results.measurement_facts(task, {"test": len(new)}) | {"refit": list(refit)},
        "warnings": list(new.notes),
        "accuracy": {"test": results.accuracy_facts(errors)},
        "against": "noisy measurement",
    }
    if out is not None:
        with run_folder(out) as folder:
            write_json(folder / "results.json", content)
            (folder / "tables").mkdir()
            _table(errors, new.labels).to_csv(folder / "tables" / "errors.csv", index=False)
    return content


def _task(robot: Robot, file: Path, refit: tuple[str, ...], state: str) -> Task:
    assert robot.record is not None
    found = robot.record.provenance.get("measurement")
    if not isinstance(found, dict) or found.get("type") not in KINDS:
        raise InputError("the calibration does not say how it was measured", file=file, key="calibration.provenance")
    parts = []
    for part in refit:
        if part not in _PARTS:
            raise InputError("no such part to fit", key="--refit", found=part, allowed=_PARTS)
        parts.append(part)
    if KINDS[found["type"]].place:
        return pixels_task(recorded_scene(found["scene"], state, file), parts)
    points = {name: (float(x), float(y), float(z)) for name, (x, y, z) in (found.get("points_mm") or {}).items()}
    return Task(
        kind=found["type"],
        estimate=frozenset(parts),
        points=points or {"P": (0.0, 0.0, 0.0)},
        invert=bool(found.get("invert", False)),
    )


def _state(model: Model, robot: Robot, data: Any, refit: tuple[str, ...]) -> State:
    start = replace(model, setup=replace(model.setup, base=robot.base, tool=robot.tool))
    setup = place(start, data, Options()) if refit else start.setup
    return State(start, setup, np.zeros(len(model.parameters)))


def _table(errors: dict[str, Errors], labels: tuple[str, ...]) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {"state": state, "pose": labels[found.pose[k]], "position_mm": norm}
            for state, found in errors.items()
            for k, norm in enumerate(found.position)
        ]
    )
