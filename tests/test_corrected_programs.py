"""Programs with corrected targets: what is corrected gets there, what is left is named; RAPID by rapidchecker too."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from decisions import ACCEPTED
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from symcal.compensation.targets import tool_pose
from symcal.errors import InputError
from symcal.programs.correct import Corrected, correct_program
from symcal.programs.grammars import GRAMMARS
from symcal.programs.literals import find_literals
from symcal.robot.files import load_robot, save_robot
from symcal.robot.robot import Record, Robot

with warnings.catch_warnings():  # it calls pyparsing by old names
    warnings.simplefilter("ignore", DeprecationWarning)
    from rapidchecker.check import check_format

pytestmark = pytest.mark.filterwarnings("ignore:.*deprecated:DeprecationWarning")
Array = NDArray[np.float64]
ARMS = Path(__file__).parents[1] / "symcal" / "robot" / "arms"
NINES = "[9E9,9E9,9E9,9E9,9E9,9E9]"


def calibrated(name: str) -> Robot:
    robot, rng = load_robot(ARMS / f"{name}.yaml"), np.random.default_rng(3)
    errors = {p: float(rng.normal() * (0.5 if p.split("_")[0] in ("a", "d") else 1e-3)) for p in robot.parameters}
    record = Record(errors, dict.fromkeys(errors, 0.1), np.eye(len(errors)), robot.base, robot.tool, ACCEPTED)
    return replace(robot.corrected(errors), record=record)


@pytest.fixture(scope="module")
def ur() -> Robot:
    return calibrated("ur5e")


@pytest.fixture(scope="module")
def abb() -> Robot:
    return calibrated("abb_irb120")


@pytest.fixture(scope="module")
def kuka() -> Robot:
    return calibrated("kuka_kr6_r900_sixx")


def corrected(text: str, suffix: str, robot: Robot, folder: Path, *, frames: bool = False) -> Corrected:
    path = folder / f"program{suffix}"
    path.write_text(text, encoding="utf-8")
    return correct_program(path, robot, np.random.default_rng(1), frames=frames)


def gets_there(robot: Robot, before: Array, after: Array) -> None:
    """The calibrated robot with new joints where the nominal one was sent."""
    wanted, found = np.asarray(tool_pose(robot.nominal())(before)), np.asarray(tool_pose(robot)(after))
    assert np.abs(wanted - found)[:3, 3].max() < 2e-5  # mm, by six digits of a degree
    assert np.abs(wanted - found)[:3, :3].max() < 1e-7
    assert np.abs(before - after).max() > 1e-4


def inside(text: str, pattern: str) -> list[list[float]]:
    return [
        [float(value) for value in re.findall(r"-?\d+\.?\d*(?:[eE]-?\d+)?", part)] for part in re.findall(pattern, text)
    ]


UR = """def work():
  # movej([9, 9, 9, 9, 9, 9]) is a comment
  home = [0.1, -1.2, 1.0, -1.5, -1.5, 0.2]
  via = [0.3, -1.2, 1.0, -1.5, -1.5, 0.2]
  movej(home, a=1.2, v=0.5)
  movej([0.5,-1.3, 1.1, -1.4, -1.6, 0.0], a=1.2)
  movel([0.6, -1.3, 1.1, -1.4, -1.6, 0.0])
  via[0] = via[0] + 0.1
  movej(via)
  movel(pose_add(get_actual_tcp_pose(), p[0, 0, 0.1, 0, 0, 0]))
  textmsg("movej([1,1,1,1,1,1])")
end
"""


def test_urscript(ur: Robot, tmp_path: Path) -> None:
    found = corrected(UR, ".script", ur, tmp_path)
    assert found.count == 3
    before, after = (inside(text, r"(?:home = |movej\(|movel\()\[([^\]]*)\]") for text in (UR, found.text))
    before, after = ([row for row in rows if 9 not in row and row != [1.0] * 6] for rows in (before, after))
    for old, new in zip(before, after, strict=True):
        gets_there(ur, np.array(old), np.array(new))
    assert [(each.line, each.why.removeprefix("via is ")) for each in found.left] == [
        (4, "used or changed elsewhere than as the target of a motion"),
        (10, "not numbers, nor a name that is given numbers in this file"),
    ]
    # all but the numbers stands as it stood
    numbers = r"(?<=\[)[^\]]*(?=\])"
    assert re.sub(numbers, "", found.text) == re.sub(numbers, "", UR)
    for kept in ("via = [0.3, -1.2", "via[0] = via[0] + 0.1", "movej([9, 9", 'textmsg("movej([1,1'):
        assert kept in found.text


RAPID = f"""MODULE work
  ! MoveAbsJ [[1,1,1,1,1,1],{NINES}],v100,fine,tool0;
  CONST jointtarget home:=[[10,-20,30,15,40,-25],{NINES}];
  PERS jointtarget unused:=[[10,-20,30,15,40,-25],{NINES}];
  CONST robtarget p10:=[[PLACE],[TURN],[0,0,-1,0],{NINES}];
  CONST robtarget p20:=[[400,0,500],[0,0,1,0],[0,0,0,0],{NINES}];
  VAR robtarget p30;

  PROC main()
    MoveAbsJ HOME\\NoEOffs,v100,fine,tool0;
    MoveAbsJ [[-15.5,12,8,60,-45,90],{NINES}]\\NoEOffs,v100,z10,tool0;
    MoveL p10,v100,fine,tool0\\WObj:=wobj0;
    MoveL Offs(p20,0,0,50),v100,fine,tool0;
    MoveL p20,v100,fine,tool0;
    p30:=CRobT();
    MoveJ p30,v100,fine,tool0;
  ENDPROC
ENDMODULE
"""


def test_rapid(abb: Robot, tmp_path: Path) -> None:
    q = np.radians([10, -20, 30, 15, 40, -25])
    pose = np.asarray(tool_pose(abb.nominal())(q))
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    text = RAPID.replace("PLACE", ",".join(f"{v:.9f}" for v in pose[:3, 3])).replace(
        "TURN", f"{w:.12f},{x:.12f},{y:.12f},{z:.12f}"
    )
    assert check_format(text) == []
    for frames in (False, True):
        found = corrected(text, ".mod", abb, tmp_path, frames=frames)
        assert check_format(found.text) == []
        assert found.count == 2 + frames
        joints = r"(?:home:=|  MoveAbsJ )\[\[([^\]]*)\]"
        old, new = (inside(each, joints) for each in (text, found.text))
        for before, after in zip(old, new, strict=True):
            gets_there(abb, np.radians(before), np.radians(after))
        assert "! MoveAbsJ [[1,1,1,1,1,1]" in found.text
        left = {each.line: each.why for each in found.left}
        assert left[4] == "nothing in this file moves to unused"
        assert left[6] == "p20 is used or changed elsewhere than as the target of a motion"
        assert {13, 16} <= set(left)
        assert ("--frame base" in left[5]) if not frames else (5 not in left)
    # the controller's inverse of the new frame, here by the joints that compensation found, is where it should be
    (place,), (turn,) = (
        inside(found.text, r"p10:=\[\[([^\]]*)\]"),
        inside(found.text, r"p10:=\[\[[^\]]*\], \[([^\]]*)\]"),
    )
    after = np.asarray(tool_pose(abb.nominal())(found.result.joints[1]))  # type: ignore[union-attr]
    assert place == pytest.approx(after[:3, 3].tolist(), abs=1e-5)
    off = Rotation.from_quat([*turn[1:], turn[0]]) * Rotation.from_matrix(after[:3, :3]).inv()
    assert off.magnitude() < 1e-8
    gets_there(abb, q, found.result.joints[1])  # type: ignore[union-attr]


KRL = """&ACCESS RVP
DEF work( )
; PTP {A1 1, A2 1, A3 1, A4 1, A5 1, A6 1}
DECL E6AXIS HOME={A1 5, A2 -80, A3 85, A4 10, A5 20, A6 -5, E1 0}
PTP home
PTP {E6AXIS: A1 15, A2 -70.5, A3 75, A4 -10, A5 30, A6 -5, E1 12.5} C_PTP
LIN {X 1, Y 2}
LIN_REL {X 0, Y 0, Z 10}
PTP {A1 20}
PTP XP7
PTP {X PX, Y PY, Z PZ, A PA, B PB, C PC, S 2, T TURN}
END
"""


def test_krl(kuka: Robot, tmp_path: Path) -> None:
    q = np.radians([15, -70.5, 75, -10, 30, -5])
    pose = np.asarray(tool_pose(kuka.nominal())(q))
    a, b, c = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
    values = dict(zip(("PX", "PY", "PZ", "PA", "PB", "PC"), (*pose[:3, 3], a, b, c), strict=True))
    text = KRL
    for name, value in values.items():
        text = text.replace(name, f"{value:.9f}")
    text = text.replace("TURN", str(sum(1 << i for i in range(6) if q[i] < 0)))
    found = corrected(text, ".src", kuka, tmp_path, frames=True)
    assert found.count == 3
    pattern = r"(?:HOME=|PTP )\{(?:E6AXIS: )?(A1 [^}]*A6 [-\d.]*)"
    old, new = ([[row[k] for k in range(1, 12, 2)] for row in inside(each, pattern)] for each in (text, found.text))
    for before, after in list(zip(old, new, strict=True))[1:]:  # but the comment
        gets_there(kuka, np.radians(before), np.radians(after))
    assert ", E1 12.5} C_PTP" in found.text
    assert [each.line for each in found.left] == [7, 8, 9, 10]
    assert found.left[1].why == "a relative motion"
    frame = inside(found.text, r"PTP \{(X [^S]*), S 2")[0]
    after = np.asarray(tool_pose(kuka.nominal())(found.result.joints[2]))  # type: ignore[union-attr]
    assert frame[:3] == pytest.approx(after[:3, 3].tolist(), abs=1e-5)
    assert (
        Rotation.from_euler("ZYX", frame[3:], degrees=True) * Rotation.from_matrix(after[:3, :3]).inv()
    ).magnitude() < 1e-7
    gets_there(kuka, q, found.result.joints[2])  # type: ignore[union-attr]


def test_a_frame_of_many_postures_is_left(ur: Robot, tmp_path: Path) -> None:
    """Its corrections differ by posture, and URScript says nothing of it."""
    pose = np.asarray(tool_pose(ur.nominal())(np.array([0.1, -1.2, 1.0, -1.5, -1.5, 0.2])))
    numbers = [*(pose[:3, 3] / 1e3), *Rotation.from_matrix(pose[:3, :3]).as_rotvec()]
    found = corrected(
        f"movel(p[{', '.join(f'{v:.9f}' for v in numbers)}], a=1)\n", ".script", ur, tmp_path, frames=True
    )
    assert found.count == 0
    assert re.fullmatch(
        r"\d+ postures fit it, whose corrections are up to [\d.]+ mm apart: give its joints", found.left[0].why
    )
    far = corrected("movel(p[5, 0, 0, 0, 0, 0])\n", ".script", ur, tmp_path, frames=True)
    assert "gets there in no posture" in far.left[0].why


def test_what_is_no_program(ur: Robot, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not the name of a program"):
        corrected("", ".txt", ur, tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        correct_program(tmp_path / "none.mod", ur, np.random.default_rng(1))
    with pytest.raises(InputError, match=r"program.script:2: .*elbow is outside its limits, -180 to 180 deg"):
        corrected("\nmovej([0, 0, 4, 0, 0, 0])\n", ".script", ur, tmp_path)
    nothing = corrected("\xff\x00 nothing here", ".src", ur, tmp_path)
    assert (nothing.count, nothing.left, nothing.result) == (0, (), None)


@given(
    st.sampled_from(list(GRAMMARS)), st.text(alphabet='MoveAbsJLPTIN movejl([{}])=:,;!#\n"pA1X0123.-E9_', max_size=200)
)
def test_any_text_is_read(language: str, text: str) -> None:
    for literal in find_literals(text, GRAMMARS[language]).literals:
        assert text[literal.start : literal.end].strip()


def test_the_command(ur: Robot, tmp_path: Path) -> None:
    save_robot(ur, tmp_path / "calibrated.yaml")
    (tmp_path / "work.script").write_text(UR, encoding="utf-8")
    command = [sys.executable, "-m", "symcal.cli", "compensate", "calibrated.yaml", "--program", "work.script"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(r"3 targets corrected, by up to [\d.]+ mm; 2 left as they were", done.stdout)
    assert "left, line 10: movel(pose_add(get_actual_tcp_pose()" in done.stdout
    assert (tmp_path / "work_corrected.script").read_text(encoding="utf-8") != UR
    assert (tmp_path / "work.script").read_text(encoding="utf-8") == UR
    both = subprocess.run([*command, "--targets", "t.csv"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert both.returncode == 2
    assert "either a table of targets or a program" in both.stderr
