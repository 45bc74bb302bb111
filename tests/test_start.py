"""What a command loads: libraries that take a second only where they are used."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import symcal as sc

ROOT = Path(__file__).resolve().parents[1]
HEAVY = ("scipy.stats", "scipy.optimize", "pandas", "matplotlib", "cv2", "pymoo", "typst", "PIL")

_RUN = """
import json, sys
from symcal.cli import main
sys.argv = ["symcal", *sys.argv[1:]]
try:
    main()
except SystemExit as end:
    if end.code:
        raise
print("loaded " + json.dumps(sorted(sys.modules)))
"""


@pytest.fixture(scope="module")
def measured_experiment(configs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An experiment whose robot was measured at random postures, half of them held out."""
    folder, rng = tmp_path_factory.mktemp("measured"), np.random.default_rng(1)
    path = configs / "robots" / "handling_robot.yaml"
    robot = sc.load_robot(path)
    model = sc.build_model(robot, sc.Task.of("position", {"base"}))
    truth = {"theta_4": 0.01, "alpha_2": -0.02, "d_5": 1.5, "base_x": 100.0}
    q = rng.uniform(robot.lower, robot.upper, (60, robot.dof))
    data = sc.simulate(model, truth, q, sc.Noise(position=0.05), rng)
    sc.save_measurements(data, robot, folder / "measured.csv")
    experiment = folder / "measured.yaml"
    experiment.write_text(
        f"schema: symcal/experiment/1\nname: measured\nrobot: {path}\nunits: {{length: mm, angle: deg}}\n"
        "measurement: {type: position, estimate: [base]}\n"
        "data: {source: file, file: measured.csv, split: {test_fraction: 0.5}}\n"
    )
    return experiment


def loaded(*args: str | Path) -> set[str]:
    """The modules in a process that has run a command."""
    where = {"env": os.environ | {"COLUMNS": "100"}, "cwd": ROOT, "check": True, "capture_output": True, "text": True}
    done = subprocess.run([sys.executable, "-c", _RUN, *map(str, args)], **where)
    line = next(line for line in done.stdout.splitlines() if line.startswith("loaded "))
    return set(json.loads(line.removeprefix("loaded ")))


@pytest.mark.parametrize("file", ["handling_robot.yaml", "robots/handling_robot.yaml", "simulated_arm.yaml"])
def test_a_check_loads_no_science(file: str) -> None:
    found = loaded("check", ROOT / "configs" / file)
    assert not found.intersection((*HEAVY, "scipy.linalg", "scipy.special", "scipy.spatial"))
    assert not [name for name in found if name.startswith(("symcal.vision", "symcal.planning", "symcal.plots"))]


def test_an_identification_without_a_report_loads_no_figures(measured_experiment: Path, tmp_path: Path) -> None:
    found = loaded("identify", measured_experiment, "--no-report", "--out", tmp_path / "run")
    assert not found.intersection(HEAVY)
    assert not [name for name in found if name.startswith(("symcal.vision", "symcal.planning.search", "symcal.plots"))]


def test_help_loads_neither_numbers_nor_tables() -> None:
    found = loaded("--help")
    assert not found.intersection((*HEAVY, "numpy", "casadi", "pydantic", "yaml", "rich.console"))


def test_no_report_leaves_all_numbers(measured_experiment: Path, tmp_path: Path) -> None:
    for name, options in (("with", ()), ("without", ("--no-report",))):
        loaded("identify", measured_experiment, *options, "--out", tmp_path / name)
    whole, plain = (
        {path.relative_to(tmp_path / name).as_posix() for path in (tmp_path / name).rglob("*") if path.is_file()}
        for name in ("with", "without")
    )
    assert whole - plain == {"report.pdf"} | {name for name in whole if name.startswith("figures/")}
    assert plain < whole
    made = json.loads((tmp_path / "without" / "manifest.json").read_text())
    assert "report.pdf" not in json.dumps(made)
    numbers = [json.loads((tmp_path / n / "results.json").read_text()) for n in ("with", "without")]
    assert numbers[0]["identification"] == numbers[1]["identification"]
