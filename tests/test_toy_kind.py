"""A kind of instrument that one file registers goes through every command without another line anywhere."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from test_several import ROBOT

import symcal as sc
from symcal.documents.yaml_dialect import parse_value

EXPERIMENT = """
name: levelled
units: {length: mm, angle: deg}
robot: robot.yaml
measurements:
  level:
    instrument: level
    stretched: true
    noise: {height: 0.02}
    at: {on: base, place: unknown}
    target: {on: flange, points: {P: [20, 30, 80]}}
data: {source: simulated, truth: {sigma_length: 0.2, sigma_angle: 0.1, errors: {level_scale: 0.001}}, test_poses: 40}
plan: {poses: 60, promise: {counts: [60], random: 4}, sample: 200, random: 20, compare: []}
"""

COMMANDS = """
import sys
import toy_kind
from symcal.cli import app

for arguments in (
    ["check", "level.yaml"],
    ["schema"],
    ["plan", "level.yaml", "--out", "plan", "--set", "plan.method=random"],
    ["run", "level.yaml", "--out", "run"],
    ["identify", "again.yaml", "--out", "again", "--set", "outputs.report=false", "--set", "outputs.figures=false"],
    ["validate", "run/calibrated.yaml", "--data", "run/measurements.csv", "--out", "validated"],
    ["export", "run/calibrated.yaml", "--to", "json", "--out", "robot.json"],
):
    print("##", *arguments)
    app(arguments, standalone_mode=False)
"""


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """What the commands left and said; in a process of its own, for a kind once registered stays."""
    folder = tmp_path_factory.mktemp("toy")
    sc.save_robot(ROBOT, folder / "robot.yaml")
    (folder / "level.yaml").write_text(EXPERIMENT)
    again = EXPERIMENT[: EXPERIMENT.index("data:")] + "data: {source: file, file: run/measurements.csv}\n"
    (folder / "again.yaml").write_text(again)
    path = os.pathsep.join(filter(None, (str(Path(__file__).parent), os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path, "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return folder, done.stdout


def test_its_file_is_short() -> None:
    lines = Path(__file__).with_name("toy_kind.py").read_text(encoding="utf-8").splitlines()
    assert len(lines) < 60


def test_check_and_the_schema_name_it(commands: tuple[Path, str]) -> None:
    assert "heights" in commands[1]
    assert '"level"' in commands[1]


def test_it_is_planned_simulated_and_identified(commands: tuple[Path, str]) -> None:
    folder, _ = commands
    plan = json.loads((folder / "plan" / "results.json").read_text())
    assert plan["plan"]["d_efficiency_lower_bound"] > 0.2
    assert plan["plan"]["noise"] == {
        "height": {"sigma": 0.02, "unit": "mm", "quantity": "height", "instrument": "level"}
    }
    found = json.loads((folder / "run" / "results.json").read_text())
    assert found["measurement"]["of_tool"] is False
    accuracy = {state: each["height_mm"]["rms"] for state, each in found["accuracy"]["truth"].items()}
    assert accuracy["after"] < 0.1 * accuracy["before"]
    scale = found["identification"]["parameters"]["level_scale"]
    assert abs(scale["identified"] - 0.001) < 4 * scale["sigma"] < 1e-3
    assert (folder / "run" / "report.pdf").stat().st_size > 20_000


def test_its_data_are_read_back_and_judge_the_calibrated_robot(commands: tuple[Path, str]) -> None:
    folder, _ = commands
    first, again = (json.loads((folder / name / "results.json").read_text()) for name in ("run", "again"))
    numbers = [
        {name: p["error"] for name, p in found["identification"]["parameters"].items() if "level" not in name}
        for found in (first, again)
    ]
    assert numbers[1] == pytest.approx(numbers[0], rel=1e-3, abs=1e-5)
    validated = json.loads((folder / "validated" / "results.json").read_text())["accuracy"]["test"]
    assert validated["after"]["height_mm"]["rms"] < 0.1 < validated["before"]["height_mm"]["rms"]
    record = parse_value((folder / "run" / "calibrated.yaml").read_text())["calibration"]["provenance"]["measurements"]
    assert record["level"]["instrument"] == "level"
    assert record["level"]["after"]["settings"]["stretched"] is True
