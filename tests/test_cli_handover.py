"""`symcal compensate` and `symcal export` as a user meets them: files, messages, exit codes."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from arms_with_terms import puma_with_terms
from cases import TABLE_III, handling
from decisions import ACCEPTED

from symcal import spatial
from symcal.cli import main
from symcal.compensation.compensate import REACHED
from symcal.compensation.targets import tool_pose
from symcal.joints.backlash import Backlash
from symcal.kernels.batch import batch_function
from symcal.robot.files import load_robot, save_robot
from symcal.robot.robot import Record, Robot
from symcal.robot.urdf import load_urdf


@dataclass(frozen=True)
class Done:
    code: int
    out: str
    err: str


Command = Callable[..., Done]


@pytest.fixture
def symcal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """The command, run in a folder of its own."""

    def call(*words: object) -> Done:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["symcal", *(str(word) for word in words)])
        with pytest.raises(SystemExit) as end:
            main()
        said = capsys.readouterr()
        code = end.value.code
        return Done(code if isinstance(code, int) else 0 if code is None else 1, said.out, said.err)

    return call


def calibrated(errors: Mapping[str, float] = TABLE_III, base: np.ndarray | None = None) -> Robot:
    robot = handling()
    where = np.eye(4) if base is None else base
    covariance = 1e-8 * np.eye(len(errors))
    record = Record(dict(errors), dict.fromkeys(errors, 1e-4), covariance, where, robot.tool, {"seed": 1} | ACCEPTED)
    return replace(robot.corrected(errors), base=where, record=record)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    save_robot(calibrated(), tmp_path / "calibrated.yaml")
    return tmp_path / "calibrated.yaml"


@pytest.fixture
def commands(tmp_path: Path) -> Path:
    rng = np.random.default_rng(3)
    q = rng.uniform([-80, 900, 50, 20, -100], [80, 1300, 650, 150, 100], (50, 5))
    table = pd.DataFrame(q, columns=["q1_deg", "q2_mm", "q3_mm", "q4_deg", "q5_deg"])
    table.to_csv(tmp_path / "targets.csv", index=False)
    return tmp_path / "targets.csv"


def readings(path: Path) -> np.ndarray:
    table = pd.read_csv(path)
    values = [np.radians(table[c]) if c.endswith("_deg") else table[c] for c in table.columns if c.startswith("q")]
    return np.column_stack(values)


def positions(robot: Robot, q: np.ndarray) -> np.ndarray:
    return np.asarray(batch_function(tool_pose(robot), evaluations=0)(q)[0][:, :3, 3])


# ---------------------------------------------------------------------------------------------------------- compensate


def test_compensated_commands_bring_the_tool_where_it_was_wanted(symcal: Command, file: Path, commands: Path) -> None:
    done = symcal("compensate", file, "--targets", commands)
    assert done.code == 0, done.err
    assert "50 targets: 50 reached" in done.out
    assert "written to joints.csv" in done.out
    table = pd.read_csv(file.parent / "joints.csv")
    assert set(table["status"]) == {"reached"}
    assert table["uncompensated_mm"].mean() > 1
    wanted = positions(handling(), readings(commands))
    found = positions(load_robot(file), readings(file.parent / "joints.csv"))
    assert np.linalg.norm(found - wanted, axis=1).max() < 2 * REACHED


def test_targets_in_world(symcal: Command, tmp_path: Path, commands: Path) -> None:
    base = spatial.transform(spatial.rpy_matrix(np.array([0.1, -0.2, 1.5])), np.array([2000.0, -500.0, 100.0]))
    save_robot(calibrated(base=base), tmp_path / "moved.yaml")
    wanted = positions(handling(), readings(commands))
    in_world = wanted @ base[:3, :3].T + base[:3, 3]
    pd.DataFrame(in_world, columns=["x_mm", "y_mm", "z_mm"]).to_csv(tmp_path / "points.csv", index=False)
    done = symcal("compensate", "moved.yaml", "--targets", "points.csv", "--frame", "world", "--out", "world.csv", "-q")
    assert (done.code, done.out) == (0, "")
    found = positions(load_robot(tmp_path / "moved.yaml"), readings(tmp_path / "world.csv"))
    assert np.linalg.norm(found - wanted, axis=1).max() < 2 * REACHED


def test_an_unknown_frame_is_refused(symcal: Command, file: Path, commands: Path) -> None:
    done = symcal("compensate", file, "--targets", commands, "--frame", "flange")
    assert done.code == 1
    assert "--frame" in done.err
    assert "flange" in done.err
    assert "base" in done.err
    assert "world" in done.err
    assert not (file.parent / "joints.csv").exists()


def test_a_robot_that_was_never_calibrated_has_nothing_to_correct(
    symcal: Command, configs: Path, commands: Path
) -> None:
    robot = configs / "robots" / "handling_robot.yaml"
    done = symcal("compensate", robot, "--targets", commands)
    assert done.code == 1
    assert "no 'calibration'" in done.err
    assert "handling_robot.yaml" in done.err
    assert not (commands.parent / "joints.csv").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("q1,q2_mm,q3_mm,q4_deg,q5_deg\n0,1000,100,90,0\n", "q1"),
        ("q1_deg,q2_mm,q3_mm,q4_deg,q5_deg\n0,1000,100,270,0\n", "joint 'elbow' is outside its limits"),
        ("x_mm,y_mm,z_mm,qx,qy,qz,qw\n0,500,1000,0,0,0,1\n", "5 joints"),
        ("x_mm,y_mm\n1,2\n", "z"),
        ("", "empty"),
    ],
)
def test_unusable_targets_are_one_message(symcal: Command, file: Path, tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "bad.csv").write_text(text)
    done = symcal("compensate", file, "--targets", "bad.csv")
    assert done.code == 1
    assert words in done.err
    assert "Traceback" not in done.err
    assert not (tmp_path / "joints.csv").exists()


def test_missing_options_are_a_usage_error(symcal: Command, file: Path) -> None:
    assert symcal("compensate", file).code == 2
    assert symcal("export", file).code == 2


# -------------------------------------------------------------------------------------------------------------- export


def test_every_format_is_written(symcal: Command, file: Path, tmp_path: Path) -> None:
    formats = {
        "c": {"c"},
        "urdf": {"robot.urdf"},
        "xacro": {"calibration.xacro", "robot.urdf.xacro"},
        "offsets": {"joint_offsets.csv", "joint_offsets.yaml", "transmissions.xml"},
        "json": {"robot.json", "corrections.csv"},
    }
    for to, names in formats.items():
        done = symcal("export", file, "--to", to, "--out", to)
        assert done.code == 0, done.err
        assert {path.name for path in (tmp_path / to).iterdir()} == names
        assert done.err.startswith("With these zeros" if to == "offsets" else "")
        assert to == "offsets" or not done.err
        for name in names:
            assert name in done.out
    assert (tmp_path / "c" / "c" / "handling_robot_kinematics.c").is_file()
    assert json.loads((tmp_path / "json" / "robot.json").read_text())["parameters"]["a_4"]["error"] == -0.076
    again = load_urdf(tmp_path / "urdf" / "robot.urdf", *_ends(tmp_path / "urdf" / "robot.urdf"))
    q = readings_in(handling(), 20)
    np.testing.assert_allclose(positions(again, q), positions(calibrated(), q), atol=1e-8)


def readings_in(robot: Robot, count: int) -> np.ndarray:
    return np.random.default_rng(5).uniform(robot.lower, robot.upper, (count, robot.dof))


def _ends(path: Path) -> tuple[str, str]:
    """The link that is no child and the one that is no parent."""
    from xml.etree import ElementTree

    joints = ElementTree.parse(path).getroot().findall("joint")
    parents, children = ({j.find(kind).get("link") for j in joints} for kind in ("parent", "child"))  # type: ignore[union-attr]
    return str((parents - children).pop()), str((children - parents).pop())


def test_an_unknown_format_is_refused(symcal: Command, file: Path, tmp_path: Path) -> None:
    done = symcal("export", file, "--to", "ros", "--out", "out")
    assert done.code == 1
    assert "--to" in done.err
    for word in ("ros", "c", "urdf", "json"):
        assert word in done.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("to", ["c", "urdf", "json"])
def test_doubtful_corrections_need_force(symcal: Command, tmp_path: Path, to: str) -> None:
    save_robot(calibrated({**TABLE_III, "theta_5": -0.37}), tmp_path / "wild.yaml")
    done = symcal("export", "wild.yaml", "--to", to, "--out", "out")
    assert done.code == 1
    assert "theta_5 is off by -21.2 deg" in done.err
    assert "force" in done.err
    assert not (tmp_path / "out").exists()
    forced = symcal("export", "wild.yaml", "--to", to, "--out", "out", "--force")
    assert forced.code == 0
    assert "doubt overridden: theta_5 is off by -21.2 deg" in forced.err
    assert any((tmp_path / "out").iterdir())


def test_a_nominal_robot_can_be_exported_and_it_is_said(symcal: Command, configs: Path, tmp_path: Path) -> None:
    done = symcal("export", configs / "robots" / "handling_robot.yaml", "--to", "c", "--out", "out")
    assert done.code == 0
    assert "what is written is nominal" in done.err
    assert "never calibrated" in (tmp_path / "out" / "c" / "README.md").read_text()


def test_a_strangers_folder_is_left_alone(symcal: Command, file: Path, tmp_path: Path) -> None:
    (tmp_path / "out" / "c").mkdir(parents=True)
    (tmp_path / "out" / "c" / "thesis.tex").write_text("mine")
    done = symcal("export", file, "--to", "c", "--out", "out")
    assert done.code == 1
    assert "thesis.tex" in done.err
    assert [path.name for path in (tmp_path / "out" / "c").iterdir()] == ["thesis.tex"]


def test_files_that_are_not_there(symcal: Command, file: Path) -> None:
    for words in (
        ("export", "nowhere.yaml", "--to", "c"),
        ("compensate", "nowhere.yaml", "--targets", "x.csv"),
        ("compensate", file, "--targets", "nowhere.csv"),
    ):
        done = symcal(*words)
        assert done.code == 1
        assert "nowhere" in done.err
        assert "Traceback" not in done.err


def test_joint_terms_leave_only_with_a_word(symcal: Command, tmp_path: Path) -> None:
    """URDF refuses them or says what their loss costs; C and compensation say what they keep at nominal."""
    robot = puma_with_terms()
    play = replace(robot, terms=(*robot.terms, Backlash(3, True, {"backlash": 5e-4})))
    save_robot(play, tmp_path / "arm.yaml")
    done = symcal("export", "arm.yaml", "--to", "urdf", "--out", "out")
    assert done.code == 1
    assert "joint terms that URDF cannot carry" in done.err
    assert "--approximate" in done.err
    assert not (tmp_path / "out").exists()
    done = symcal("export", "arm.yaml", "--to", "urdf", "--out", "out", "--approximate")
    assert done.code == 0, done.err
    assert "URDF leaves out: harmonics 1 and 2 of axis 1" in done.err
    assert "searched" in done.err
    assert "The tool is then up to" in (tmp_path / "out" / "robot.urdf").read_text()
    done = symcal("export", "arm.yaml", "--to", "c", "--out", "out")
    assert done.code == 0
    assert "The C code keeps at nominal: backlash of axis 3" in done.err
    done = symcal("export", "arm.yaml", "--to", "json", "--out", "out")
    assert "A table of zero offsets and lengths leaves out" in done.err
    assert json.loads((tmp_path / "out" / "robot.json").read_text())["terms"][-1]["kind"] == "backlash"
    names = ",".join(f"q{i}_deg" for i in range(1, 7))
    (tmp_path / "commands.csv").write_text(f"{names}\n10,-20,30,40,50,60\n")
    done = symcal("compensate", "arm.yaml", "--targets", "commands.csv")
    assert done.code == 0, done.err
    assert "A command keeps at nominal: backlash of axis 3" in done.err
    done = symcal("import", tmp_path / "out" / "robot.urdf", "--base", "base_link", "--tip", "tool")
    assert done.code == 0, done.err
