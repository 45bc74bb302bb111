"""What a command loads: libraries that take a second only where they are used."""

from __future__ import annotations

import gc
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main
from typer.testing import CliRunner

import symcal as sc
from symcal import cli

ROOT = Path(__file__).resolve().parents[1]
HEAVY = ("scipy.stats", "scipy.optimize", "pandas", "matplotlib", "cv2", "pymoo", "typst", "PIL", "jinja2")
READERS = ("python_calamine", "rosbags", "symcal.readers.hand_eye", "symcal.readers.bags")

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


@pytest.fixture(scope="module")
def with_report(measured_experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, set[str]]:
    """The folder that an identification leaves, and what its process has loaded."""
    folder = tmp_path_factory.mktemp("with") / "run"
    return folder, loaded("identify", measured_experiment, "--out", folder)


@pytest.fixture(scope="module")
def without_report(measured_experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, set[str]]:
    folder = tmp_path_factory.mktemp("without") / "run"
    return folder, loaded("identify", measured_experiment, "--no-report", "--out", folder)


@pytest.mark.parametrize("file", ["handling_robot.yaml", "robots/handling_robot.yaml", "simulated_arm.yaml"])
def test_a_check_loads_no_science(file: str) -> None:
    found = loaded("check", ROOT / "configs" / file)
    assert not found.intersection((*HEAVY, *READERS, "scipy.linalg", "scipy.special", "scipy.spatial"))
    rooms = ("vision", "images", "planning", "plots", "report", "page", "placing", "export", "trials")
    assert not [name for name in found if name.startswith(tuple(f"symcal.{room}" for room in rooms))]
    assert not found.intersection(("symcal.calibration.calibrate", "symcal.runs.run", "rich.progress"))


def test_an_identification_without_a_report_loads_no_figures(without_report: tuple[Path, set[str]]) -> None:
    _, found = without_report
    assert not found.intersection(HEAVY)
    assert not [
        name
        for name in found
        if name.startswith(("symcal.vision", "symcal.planning.search", "symcal.plots", "symcal.page"))
    ]


def test_an_identification_with_a_report_loads_figures_but_no_images(with_report: tuple[Path, set[str]]) -> None:
    """Of measurements that are numbers; what looks for plans is not loaded either."""
    _, found = with_report
    assert found.issuperset(("matplotlib", "typst"))
    assert not found.intersection({*HEAVY} - {"matplotlib", "typst", "PIL", "jinja2"})
    assert not [name for name in found if name.startswith(("symcal.vision", "symcal.images", "symcal.planning.search"))]


@pytest.mark.parametrize("arguments", [["check"], ["check", "--help"], ["--help"], ["chek"], []])
def test_a_command_is_read_alone_and_the_others_are_known(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Usage and errors are those of the whole command, of which only what is called has been read."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("PYDANTIC_DISABLE_PLUGINS", "true")
    monkeypatch.setattr(gc, "set_threshold", lambda *_: None)
    whole, read = list(cli.app.registered_commands), []
    answers = CliRunner().invoke(cli.app, arguments, prog_name="symcal")
    monkeypatch.setattr(sys, "argv", ["symcal", *arguments])
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    plain = typer.main.get_command_from_info

    def reads(*, command_info: Any, **given: Any) -> Any:
        read.append(command_info.name)
        return plain(command_info=command_info, **given)

    monkeypatch.setattr(typer.main, "get_command_from_info", reads)
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == answers.exit_code
    out, err = capsys.readouterr()
    said, wanted = ([line[:60] for line in text.splitlines()] for text in (out + err, answers.output))
    assert said == wanted  # the terminal's width decides where long lines end
    assert cli.app.registered_commands == whole
    assert read == (["check"] if arguments[:1] == ["check"] else [command.name for command in whole])


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("symcal ex", {"export"}),
        ("symcal export --a", {"--approximate"}),
        ("symcal identify --", {"--data", "--out", "--seed", "--set", "--no-report", "--quiet", "--json", "--help"}),
        ("symcal study --sch", {"--scheduler"}),
    ],
)
def test_the_shell_completes_commands_and_the_options_of_each(line: str, wanted: set[str]) -> None:
    """As bash asks for it, which gives the line in variables and the program's name as the only argument."""
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split()) - 1), "_SYMCAL_COMPLETE": "complete_bash"}
    code = "import sys; from symcal.cli import main; sys.argv = ['symcal']; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | asked, capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) == wanted


def test_help_loads_neither_numbers_nor_tables() -> None:
    found = loaded("--help")
    assert not found.intersection((*HEAVY, "numpy", "casadi", "pydantic", "yaml", "rich.console"))


def test_no_report_leaves_all_numbers(
    with_report: tuple[Path, set[str]], without_report: tuple[Path, set[str]]
) -> None:
    folders = (with_report[0], without_report[0])
    whole, plain = (
        {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()} for folder in folders
    )
    assert whole - plain == {"report.pdf", "report.html"} | {name for name in whole if name.startswith("figures/")}
    assert plain < whole
    made = json.loads((folders[1] / "manifest.json").read_text())
    assert "report." not in json.dumps(made)
    numbers = [json.loads((folder / "results.json").read_text()) for folder in folders]
    assert numbers[0]["identification"] == numbers[1]["identification"]
