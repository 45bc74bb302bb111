"""The command line as a stranger meets it: exit codes, one message per mistake, nothing half done."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from measured_arms import measure, write_experiment

from symcal.runs.folder import run_folder


@pytest.fixture
def experiment(tmp_path) -> Path:
    return write_experiment(measure("puma", "standard", np.random.default_rng(5), 25, 10), tmp_path, "long")


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_help_names_every_step(symcal):
    code, out, _ = symcal("--help")
    assert code == 0
    for command in ("run", "plan", "identify", "check", "validate", "compensate", "export", "import", "schema"):
        assert f"\n  {command} " in out


def test_version(symcal):
    code, out, _ = symcal("--version")
    assert (code, out.split()[0]) == (0, "symcal")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), ""),
        (("rum", "x.yaml"), "No such command 'rum'"),
        (("run",), "Missing argument 'EXPERIMENT.yaml'"),
        (("run", "x.yaml", "--ot", "y"), "No such option: --ot"),
        (("run", "x.yaml", "--seed", "-1"), "Invalid value for '--seed'"),
        (("validate", "x.yaml"), "Missing option '--data'"),
    ],
)
def test_usage_is_exit_code_two(symcal, arguments, words):
    code, out, err = symcal(*arguments)
    assert code == 2
    assert words in out + err


def test_a_run_says_what_came_out(symcal, experiment, tmp_path):
    code, out, err = symcal("run", experiment, "--out", "result")
    assert (code, err) == (0, "")
    for words in ("30 of 37 directions seen", "train", "test", "offsets_only", "after", "written to result"):
        assert words in out
    assert json.loads((tmp_path / "result" / "results.json").read_text())["name"] == "tracker"
    assert names(tmp_path) == ["data.csv", "experiment.yaml", "result", "robot.yaml"]


def test_the_folder_is_named_after_the_experiment(symcal, experiment, tmp_path):
    code, out, _ = symcal("identify", experiment, "--quiet", "--seed", "9")
    assert (code, out) == (0, "")
    assert json.loads((tmp_path / "reports" / "tracker" / "results.json").read_text())["seed"] == 9


def test_other_measurements_for_the_same_experiment(symcal, experiment, tmp_path):
    (tmp_path / "data.csv").rename(tmp_path / "monday.csv")
    code, _, err = symcal("run", experiment, "--out", "result")
    assert code == 1
    assert "key 'data.file': the file of measurements is not there" in err
    code, _, _ = symcal("identify", experiment, "--data", "monday.csv", "--out", "result")
    assert code == 0
    inputs = json.loads((tmp_path / "result" / "results.json").read_text())["inputs"]
    assert {Path(path).name for path in inputs} == {"experiment.yaml", "robot.yaml", "monday.csv"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("experiment.yaml", "measurement:", "mesurement:"), "did you mean 'measurement'?"),
        (("experiment.yaml", "file: data.csv", "file: $SYMCAL_NOWHERE/data.csv"), "SYMCAL_NOWHERE in this path is not"),
        (("robot.yaml", "alpha:", "alfa:"), "did you mean 'alpha'?"),
        (
            ("data.csv", "q3_deg", "q3"),
            "data.csv:1: column 'q3': the column of joint 3 'A3' (revolute: an angle) has no",
        ),
        (("data.csv", "\nN3,", "\nN3,,"), "data.csv:8: this row has 13 cells, the header 12"),
        (("data.csv", "train\nN4", "trian\nN4"), "column 'split': this pose has another split in line 8"),
    ],
)
def test_a_slip_in_any_file_is_one_line_and_nothing_is_written(symcal, experiment, tmp_path, change, words):
    name, old, new = change
    path = tmp_path / name
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    before = names(tmp_path)
    code, out, err = symcal("run", experiment, "--out", "result")
    assert (code, out) == (1, "")
    assert err.startswith("symcal: ")
    assert words in err
    assert err.count("\n") == 1
    assert names(tmp_path) == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "nothing.yaml"), "nothing.yaml: there is no such file"),
        (("run", "."), "this is a folder"),
        (("run", "robot.yaml"), "this is a robot file"),
        (("run", "data.csv"), "expected 'key: value' lines"),
        (("check", "data.csv"), "expected 'key: value' lines"),
        (
            ("run", "experiment.yaml", "--out", "."),
            "experiment.yaml is read by this run and lies in .: it would be lost; choose another --out",
        ),
        (("run", "experiment.yaml", "--out", "data.csv"), "data.csv is not a folder"),
        (("run", "experiment.yaml", "--out", "data.csv/x"), "the output folder cannot be used: Not a directory"),
        (
            ("run", "experiment.yaml", "--set", "sed=1"),
            "key '--set sed': unknown key (found: sed); did you mean 'seed'?",
        ),
        (("identify", "experiment.yaml", "--data", "x.csv", "--out", "y"), "x.csv: there is no such file"),
        (("validate", "robot.yaml", "--data", "data.csv"), "validate takes the calibrated.yaml of a run"),
        (("schema", "robt"), "did you mean 'robot'?"),
    ],
)
@pytest.mark.usefixtures("experiment")
def test_wrong_arguments(symcal, tmp_path, arguments, words):
    before = names(tmp_path)
    code, _, err = symcal(*arguments)
    assert code == 1
    assert words in err
    assert "Traceback" not in err
    assert names(tmp_path) == before


def test_check_a_robot_and_an_experiment(symcal, experiment, tmp_path):
    code, out, _ = symcal("check", "robot.yaml")
    assert code == 0
    for words in ("6 joints, standard convention", "tool in world with all readings at zero", "theta_1 and base_rz"):
        assert words in out
    code, out, _ = symcal("check", experiment)
    assert code == 0
    assert "30 of 37 parameter directions can be seen" in out
    assert "measurements: 35 poses (25 train, 10 test)" in out
    (tmp_path / "data.csv").unlink()
    code, out, _ = symcal("check", experiment)
    assert code == 0
    assert "the file of measurements is not there" in out


def test_validate_on_the_measurements_of_the_run(symcal, experiment, tmp_path):
    symcal("run", experiment, "--out", "result", "--quiet")
    code, out, _ = symcal("validate", "result/calibrated.yaml", "--data", "result/measurements.csv", "--out", "again")
    assert code == 0
    assert "after" in out
    assert (tmp_path / "again" / "results.json").exists()


@pytest.mark.parametrize("kind", ["experiment", "robot"])
def test_schema_is_json(symcal, kind):
    code, out, _ = symcal("schema", kind)
    assert code == 0
    assert json.loads(out)["additionalProperties"] is False


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.usefixtures("experiment")
def test_a_stopped_run_leaves_the_old_folder(tmp_path, number):
    """The process itself, stopped while it writes."""
    target = tmp_path / "result"
    with run_folder(target) as folder:
        (folder / "results.json").write_text("old")
    script = (
        "import sys, time, symcal.runs.identification_folder as e; from symcal.cli import main\n"
        "def write(*_): print('writing', flush=True); time.sleep(60)\n"
        "e.write = write; sys.argv[1:] = ['run', 'experiment.yaml', '--out', 'result']; main()"
    )
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [sys.executable, "-c", script], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"writing\n"
    assert len([p for p in tmp_path.iterdir() if p.name.startswith(".result-")]) == 2  # with the lock
    time.sleep(0.1)
    process.send_signal(number)
    _, err = process.communicate(timeout=300)
    assert process.returncode == 128 + number
    assert b"Traceback" not in err
    assert (target / "results.json").read_text() == "old"
    assert names(tmp_path) == ["data.csv", "experiment.yaml", "result", "robot.yaml"]
