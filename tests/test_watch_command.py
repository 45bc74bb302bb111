"""The command that checks a robot in service: exit codes, history, files, and one error for bad input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import watch_draws as draws

from symcal.data.saved_measurements import save_measurements
from symcal.robot.files import save_robot
from symcal.watch.history import read_history


@pytest.fixture(scope="module")
def service() -> draws.Service:
    return draws.in_service(draws.cell(), 3, pool=200)


@pytest.fixture
def folder(service, rng, tmp_path, monkeypatch) -> Path:
    """calibrated.yaml, and good.csv and bad.csv of a good day and one with joint 3 off by 1 mrad."""
    monkeypatch.chdir(tmp_path)
    robot = service.reference.robot
    save_robot(robot, "calibrated.yaml")
    save_measurements(draws.today(service, False, {}, rng), robot, "good.csv")
    save_measurements(draws.today(service, False, {"theta_3": 1e-3}, rng), robot, "bad.csv")
    return tmp_path


def test_the_command_says_it_by_its_exit_code(folder, symcal) -> None:
    where = [folder / name for name in ("calibrated.yaml", "good.csv", "bad.csv")]
    code, out, _ = symcal("watch", where[0], "--data", where[1], "--history", "h.csv", "--date", "2026-11-30")
    assert code == 0
    assert "the calibration holds by 10 poses (false alarm in 5 % of checks)" in out
    code, out, _ = symcal("watch", where[0], "--data", where[2], "--history", "h.csv", "--out", "o", "--json")
    assert code == 3
    said = json.loads(out)
    assert said["exit_code"] == 3
    assert said["error"] is None
    assert said["results"]["group"][0]["name"] == "elbow"
    assert {"results.json", "manifest.json"} <= {path.name for path in Path("o").iterdir()}
    assert {path.stem for path in Path("o/figures").iterdir()} == {"check", "history"}
    symcal("watch", where[0], "--data", where[1], "--history", "h.csv", "--date", "2026-12-01", "--quiet")
    rows = read_history(Path("h.csv"))
    assert [row["verdict"] for row in rows] == ["changed", "holds"]  # by date; the same data once
    assert rows[1]["date"] == "2026-12-01"
    assert float(rows[0]["elbow_mrad"]) == pytest.approx(1.0, abs=0.2)
    assert float(rows[0]["elbow_over_limit"]) > 1


def test_a_plan_is_a_file_of_poses_and_what_they_find(folder, symcal) -> None:
    symcal("init", "--arm", "ur5e", "--instrument", "tracker", "--out", "ur5e")
    given = ("--experiment", "ur5e/experiment.yaml", "--out", "plan", "--poses", "6", "--json")
    code, out, _ = symcal("watch", folder / "calibrated.yaml", "--plan", *given)
    assert code == 0
    found = json.loads(out)["results"]
    offsets = found["offsets"]
    assert offsets["shoulder_pan"]["still"] is not None
    assert offsets["shoulder_pan"]["moved"] is None
    assert any("shoulder_pan and the base are one answer" in line for line in found["remarks"])
    assert any("wrist_3" in line and "not seen at 0.50 mrad" in line for line in found["remarks"])
    assert len(Path("plan/plan.csv").read_text().splitlines()) == 7
    assert (np.array(found["poses"])[:, 2] >= np.deg2rad(20) - 1e-9).all()  # the experiment's area


def without_covariance(text: str) -> str:
    head, _, rest = text.partition("  covariance:\n")
    rows, _, tail = rest.partition("  nominal_base:")
    count = rows.count("- - ") or rows.count("- [")
    return f"{head}  covariance: {[[0.0] * count] * count}\n  nominal_base:{tail}"


BAD = {
    "another robot": (
        "good.csv",
        lambda t: t.replace("q6_deg", "r6_deg"),
        "joint 6",
    ),
    "no unit": ("good.csv", lambda t: t.replace("q3_deg", "q3"), "q3"),
    "no covariance": ("calibrated.yaml", without_covariance, "the calibration has no covariance"),
    "never calibrated": ("calibrated.yaml", lambda t: t.partition("calibration:")[0], "has no 'calibration'"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_error(name: str, folder, symcal) -> None:
    file, change, message = BAD[name]
    path = folder / file
    path.write_text(change(path.read_text()))
    code, _, err = symcal("watch", folder / "calibrated.yaml", "--data", folder / "good.csv")
    assert code == 1
    assert message in err
    assert err.count("symcal:") == 1
    assert "Traceback" not in err


def test_a_command_that_says_too_little_or_too_much_is_a_usage_error(folder, symcal) -> None:
    assert symcal("watch", folder / "calibrated.yaml")[0] == 2
    assert symcal("watch", folder / "calibrated.yaml", "--plan", "--data", folder / "good.csv")[0] == 2
    assert symcal("watch", folder / "calibrated.yaml", "--plan", "--history", "h.csv")[0] == 2
    code, _, err = symcal("watch", folder / "calibrated.yaml", "--data", folder / "good.csv", "--date", "monday")
    assert code == 1
    assert "--date" in err
    (folder / "notes.csv").write_text("a,b\n1,2\n")
    code, _, err = symcal("watch", folder / "calibrated.yaml", "--data", folder / "good.csv", "--history", "notes.csv")
    assert code == 1
    (folder / "calibrated.csv").write_text("a,b\n1,2\n")
    given = ("--data", folder / "good.csv", "--history", folder / "calibrated.csv")
    code, _, err = symcal("watch", folder / "calibrated.yaml", *given)
    assert code == 1
    assert "this is no history of checks" in err
    assert (folder / "calibrated.csv").read_text() == "a,b\n1,2\n"
