"""One small simulated identification with known truth, for the tests of figures and of the report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from symcal.calibration import results
from symcal.calibration.compare import compare
from symcal.calibration.evaluate import Errors, expected_position_rms
from symcal.calibration.identify import Calibration, baseline_model, calibrate
from symcal.calibration.simulate import Noise, concatenate, simulate
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Options
from symcal.model.model import Task, build_model
from symcal.robot.robot import load_robot


def simulated(
    configs: Path, kind: str, train: int = 30, test: int = 12
) -> tuple[Calibration, Dataset, Mapping[str, Mapping[str, Errors]]]:
    """The handling robot with base and tool estimated, 0.05 mm (and 0.2 mrad) of noise."""
    rng = np.random.default_rng(7)
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    points = {"P": (40.0, 0.0, 60.0)} if kind == "position" else {}
    model = build_model(robot, Task(kind, frozenset({"base", "tool"}), points))  # type: ignore[arg-type]
    truth = {
        name: rng.normal() * (0.004 if name[0] in "tb" or name.startswith("al") else 0.3) for name in model.kinematic
    }
    noise = Noise(position=0.05, orientation=2e-4)
    q = rng.uniform(robot.lower, robot.upper, (train + test, robot.dof))
    seen = simulate(model, truth, q[:train], noise, rng)
    if not test:
        return (c := calibrate(model, baseline_model(model), seen, Options())), seen, {"train": compare(c, seen)}
    data = concatenate(seen, simulate(model, truth, q[train:], noise, rng, "test"))
    calibration = calibrate(model, baseline_model(model), data, Options())
    errors = {part: compare(calibration, data.part(part)) for part in ("train", "test")}
    errors["truth"] = compare(calibration, simulate(model, truth, q[train:], Noise(), rng, "test"))
    return calibration, data, errors


def content_of(calibration: Calibration, data: Dataset, errors: Mapping[str, Mapping[str, Errors]]) -> dict[str, Any]:
    """The results dictionary that a run writes."""
    poses = {part: data.split.count(part) for part in ("train", "test") if part in data.split}
    expected = {
        part: float(
            np.sqrt(np.mean(expected_position_rms(calibration.model, calibration.after, data.part(part).q) ** 2))
        )
        for part in poses
    }
    return {
        **results.header("trial", "A trial", 7, (), Path()),
        "robot": results.robot_facts(calibration.model.robot),
        "measurement": results.measurement_facts(calibration.model.task, poses),
        "warnings": [],
        **results.calibration_facts(calibration),
        "accuracy": {part: results.accuracy_facts(found) for part, found in errors.items()},
        "expected_position_rms_mm": expected,
        "against": "noisy measurement",
    }
