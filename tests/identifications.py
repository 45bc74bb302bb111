"""One small simulated identification with known truth, for the tests of figures and of the report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from symcal.calibration import results
from symcal.calibration.calibrate import Calibration, baseline_model, calibrate
from symcal.calibration.compare import compare
from symcal.calibration.evaluate import Errors, evaluate_each, expected_position_rms
from symcal.calibration.simulate import concatenate, simulate
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Options
from symcal.instruments import kind_named
from symcal.instruments.noise import Noise
from symcal.model.model import build_model
from symcal.model.observation import Observation, Place, Target
from symcal.model.task import Task
from symcal.robot.files import load_robot
from symcal.spatial import transform

Case = tuple[Calibration, Dataset, Mapping[str, Mapping[str, Errors]]]

SMR = Target("smr", Place("flange"), {"P": (40.0, 0.0, 60.0)})
NOISE = Noise(position=0.05, orientation=2e-4, distance=0.03)


def simulated(configs: Path, kind: str, train: int = 30, test: int = 12) -> Case:
    """The handling robot with base and tool estimated, 0.05 mm (and 0.2 mrad) of noise."""
    points = {"P": (40.0, 0.0, 60.0)} if kind == "position" else {}
    task = Task.of(kind, frozenset({"base", "tool"}), points)  # type: ignore[arg-type]
    return identified(configs, task, train, test)


def wired(configs: Path, *, tracked: bool = False, train: int = 40, test: int = 12) -> Case:
    """The handling robot and a draw-wire that starts where nobody knows; with a tracker, base unknown, if wanted."""
    start = transform(np.eye(3), np.array([900.0, -700.0, 300.0]))
    wire = Observation(kind_named("distance")(), "wire", Place("world", start, unknown=True), SMR)
    tracker = [Observation(kind_named("position")(), "tracker", target=SMR)] if tracked else []
    return identified(configs, Task((wire, *tracker), base=tracked), train, test)


def identified(configs: Path, task: Task, train: int, test: int) -> Case:
    """The handling robot with drawn errors, measured, identified and judged."""
    rng = np.random.default_rng(7)
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    model = build_model(robot, task)
    truth = {
        name: rng.normal() * (0.004 if name[0] in "tb" or name.startswith("al") else 0.3) for name in model.kinematic
    }
    q = rng.uniform(robot.lower, robot.upper, (train + test, robot.dof))
    seen = simulate(model, truth, q[:train], NOISE, rng)
    if not test:
        return (c := calibrate(model, baseline_model(model), seen, Options())), seen, {"train": compare(c, seen)}
    data = concatenate(seen, simulate(model, truth, q[train:], NOISE, rng, "test"))
    calibration = calibrate(model, baseline_model(model), data, Options())
    errors = {part: compare(calibration, data.part(part)) for part in ("train", "test")}
    errors["truth"] = compare(calibration, simulate(model, truth, q[train:], Noise(), rng, "test"))
    return calibration, data, errors


def content_of(calibration: Calibration, data: Dataset, errors: Mapping[str, Mapping[str, Errors]]) -> dict[str, Any]:
    """The results dictionary that a run writes."""
    task = calibration.model.task
    each = {
        part: {name: evaluate_each(state, data.part(part)) for name, state in calibration.states.items()}
        for part in ("train", "test")
        if part in data.split
    }
    poses = {part: data.split.count(part) for part in ("train", "test") if part in data.split}
    expected = {
        part: float(
            np.sqrt(np.mean(expected_position_rms(calibration.model, calibration.after, data.part(part).q) ** 2))
        )
        for part in poses
    }
    labels = {part: data.part(part).labels for part in poses}
    return {
        **results.header("trial", "A trial", 7, (), Path()),
        "robot": results.robot_facts(calibration.model.robot),
        "measurement": results.measurement_facts(task, poses),
        "instruments": results.instrument_facts(task, each),
        "warnings": [],
        **results.calibration_facts(calibration),
        "accuracy": {part: results.accuracy_facts(found, labels.get(part)) for part, found in errors.items()},
        "expected_position_rms_mm": expected,
        "against": "noisy measurement",
    }
