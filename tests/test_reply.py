"""`--json`: one object on standard output, whatever happens, and the exit code of the command without it."""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_arms import measure, write_experiment

from symcal import cli

Call = Callable[..., tuple[int, str, str]]
KEYS = {"schema", "command", "exit_code", "written", "results", "error"}


def asked(symcal: Call, *arguments: str | Path) -> dict[str, Any]:
    """The one object that a command prints."""
    code, out, _ = symcal(*arguments, "--json")
    said = json.loads(out)
    assert said.keys() == KEYS
    assert (said["schema"], said["command"], said["exit_code"]) == ("symcal/reply/1", arguments[0], code)
    assert (code == 0) == (said["error"] is None)
    return said


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("measured")
    write_experiment(measure("puma", "standard", np.random.default_rng(5), 25, 10), path, "long")
    return path


def test_every_command_has_it() -> None:
    for command in cli.app.registered_commands:
        assert command.callback is not None
        assert "json" in inspect.signature(command.callback).parameters, command.name
        assert "reply(" in inspect.getsource(sys.modules[command.callback.__module__]), command.name


def test_from_a_run_to_the_controller(symcal: Call, folder: Path, tmp_path: Path) -> None:
    run = asked(symcal, "run", folder / "experiment.yaml", "--no-report", "--out", "run")
    assert run["written"] == ["run"]
    assert run["results"] == json.loads((tmp_path / "run" / "results.json").read_text())
    calibrated = tmp_path / "run" / "calibrated.yaml"
    compared = asked(symcal, "compare", "run", "run/calibrated.yaml")
    assert compared["written"] == []
    assert len(compared["results"]["comparison"]) == 1
    (tmp_path / "targets.csv").write_text("x_mm,y_mm,z_mm\n400,150,300\n9000,0,0\n")
    targets = asked(symcal, "compensate", calibrated, "--targets", "targets.csv")["results"]["targets"]
    assert [row["status"].split(":")[0] for row in targets] == ["reached", "out of reach"]
    exported = asked(symcal, "export", calibrated, "--to", "urdf", "--out", "out")
    assert exported["written"] == ["out/robot.urdf"]
    assert asked(symcal, "check", calibrated)["results"]["robot"]["name"]


def test_what_is_refused_brings_its_numbers(symcal: Call, folder: Path) -> None:
    tolerance = ("--set", "validation.tolerance.position=0.0001")
    arguments = ("identify", folder / "experiment.yaml", "--no-report", "--out", "run", *tolerance)
    said = asked(symcal, *arguments)
    assert said["exit_code"] == 1
    assert said["results"]["decision"]["accepted"] is False
    assert said["error"]["message"].startswith("the calibration is refused")
    assert symcal(*arguments)[0] == 1


def test_a_check_says_what_is_seen(symcal: Call, folder: Path) -> None:
    results = asked(symcal, "check", folder / "experiment.yaml")["results"]
    (seen,) = results["seen"].values()
    assert seen["rank"] + len(seen["unseen"]) == len(seen["parameters"])
    assert np.shape(results["T_world_tool_at_zero"]) == (4, 4)
    assert len(results["robot"]["joints"]) == 6


def test_an_error_has_its_parts_as_fields(symcal: Call, folder: Path, tmp_path: Path) -> None:
    robot = tmp_path / "robot.yaml"
    robot.write_text((folder / "robot.yaml").read_text().replace("convention: standard", "convention: standrad"))
    line = robot.read_text().splitlines().index("convention: standrad") + 1
    code, out, err = symcal("check", robot, "--json")
    assert json.loads(out)["error"] == {
        "message": "not one of the allowed values",
        "file": str(robot),
        "line": line,
        "part": None,
        "key": "convention",
        "column": None,
        "found": "standrad",
        "allowed": ["standard", "craig"],
    }
    assert (code, "", err) == symcal("check", robot)  # people are told the same


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("rum", "x.yaml"), "No such command 'rum'"),
        (("run",), "Missing argument 'EXPERIMENT.yaml'"),
        (("run", "x.yaml", "--ot", "y"), "No such option: --ot"),
        (("run", "x.yaml", "--seed", "-1"), "Invalid value for '--seed'"),
    ],
)
def test_wrong_usage_is_an_object_too(symcal: Call, arguments: tuple[str, ...], words: str) -> None:
    said = asked(symcal, *arguments)
    assert said["exit_code"] == 2
    assert words in said["error"]["message"]


def test_words_go_to_standard_error_and_help_stays_help(symcal: Call) -> None:
    code, out, err = symcal("schema", "robot", "--json")
    assert code == 0
    assert json.loads(out)["results"] == json.loads(err)
    code, out, _ = symcal("check", "--help", "--json")
    assert (code, out.split()[0]) == (0, "Usage:")


def test_first_files_are_named(symcal: Call) -> None:
    listed = asked(symcal, "init", "--list")["results"]
    assert "ur5e" in listed["arms"]
    instrument = listed["instruments"][0]
    said = asked(symcal, "init", "--arm", "ur5e", "--instrument", instrument, "--out", "first")
    assert said["written"]
    assert all(Path(name).is_file() for name in said["written"])
    assert said["results"]["guesses"] > 0


def test_images_boards_and_imports(symcal: Call, tmp_path: Path) -> None:
    board = asked(symcal, "board", "chessboard:9x6:25mm", "--quiet")
    assert (board["written"], board["results"]["page"]) == (["board.pdf"], "A4")
    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm"><link name="base"/><link name="tip"/><joint name="j" type="revolute"><parent link="base"/>'
        '<child link="tip"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    imported = asked(symcal, "import", "arm.urdf", "--base", "base", "--tip", "tip")
    assert imported["written"] == ["robot.yaml"]
    assert len(imported["results"]["joints"]) == 1
