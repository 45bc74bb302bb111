"""Programs for the poses of a plan, read back: RAPID by rapidchecker and a reader written here, KRL and URScript by
readers written here from the makers' manuals, of which there is no independent parser.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from symcal.errors import InputError, RefusedError
from symcal.planning.plan_file import write_plan
from symcal.programs.languages import LANGUAGES, program_files
from symcal.programs.visits import visits
from symcal.programs.write import write_program
from symcal.robot.files import load_robot
from symcal.robot.robot import Robot
from symcal.runs.load import robot_of_plan

with warnings.catch_warnings():  # it calls pyparsing by old names
    warnings.simplefilter("ignore", DeprecationWarning)
    from rapidchecker.check import check_format

pytestmark = pytest.mark.filterwarnings("ignore:.*deprecated:DeprecationWarning")
Array = NDArray[np.float64]
ARMS = Path(__file__).parents[1] / "symcal" / "robot" / "arms"
NUMBER = r"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"


@dataclass
class Driven:
    """What a controller would do: joints of every motion, rad; how long it stands; what it says; where it stops."""

    moves: list[list[float]] = field(default_factory=list)
    stood: list[float] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    stops: int = 0


def urscript(text: str) -> Driven:
    """The statements of [Universal Robots, The URScript Programming Language] that we write; any other is an error."""
    found, lines = Driven(), text.splitlines()
    head = re.fullmatch(r"def ([A-Za-z]\w*)\(\):", lines[0])
    assert head is not None
    assert lines[-2:] == ["end", f"{head[1]}()"]
    for line in lines[1:-2]:
        code = re.sub(r'^((?:[^"#]|"[^"]*")*)#.*$', r"\1", line).strip()
        if not code:
            continue
        if move := re.fullmatch(rf"movej\(\[((?:{NUMBER}(?:, )?){{6}})\], a=({NUMBER}), v=({NUMBER})\)", code):
            assert 0 < float(move[3]) < 4
            found.moves.append([float(value) for value in move[1].split(", ")])
        elif stand := re.fullmatch(rf"sleep\(({NUMBER})\)", code):
            found.stood.append(float(stand[1]))
        elif say := re.fullmatch(r'textmsg\("([^"]*)"\)', code):
            found.said.append(say[1])
        else:
            assert re.fullmatch(r'popup\("[^"]*", blocking=True\)', code), line
            found.stops += 1
    return found


def krl(text: str) -> Driven:
    """The statements of [KUKA, KSS 8.3 SI] that we write; any other is an error. Angles come in degrees."""
    found, lines = Driven(), text.splitlines()
    assert lines[0] == "&ACCESS RVP"
    assert re.fullmatch(r"DEF [A-Za-z]\w*\( \)", lines[1])
    assert lines[-1] == "END"
    assert max(map(len, lines)) <= 140
    for line in lines[2:-1]:
        if line.startswith(";"):
            found.said += [line[2:]] if "MEASURE" in line else []
        elif move := re.fullmatch(r"PTP \{(.*)\}", line):
            axes = [re.fullmatch(rf"A(\d) ({NUMBER})", each) for each in move[1].split(", ")]
            assert [axis is not None and int(axis[1]) for axis in axes] == list(range(1, len(axes) + 1))
            found.moves.append([float(np.radians(float(axis[2]))) for axis in axes if axis is not None])
        elif stand := re.fullmatch(rf"WAIT SEC ({NUMBER})", line):
            found.stood.append(float(stand[1]))
        elif line == "HALT":
            found.stops += 1
        else:
            assert re.fullmatch(rf"BAS \(#(INITMOV,0|VEL_PTP,{NUMBER})\)", line), line
    return found


def rapid(text: str) -> Driven:
    """A module that rapidchecker accepts, its declarations and statements in their order."""
    assert check_format(text) == []
    number = rf"({NUMBER})"
    axes = rf"\[\[{','.join([number] * 6)}\],\[(?:9E9,?){{6}}\]\]"
    targets = {
        found[1]: [float(np.radians(float(value))) for value in found.groups()[1:]]
        for found in re.finditer(rf"CONST jointtarget (\w+):={axes};", text)
    }
    found = Driven()
    for line in text[text.index("PROC") :].splitlines():
        code = line.strip()
        if move := re.fullmatch(r"MoveAbsJ (\w+)\\NoEOffs,v1000,fine,tool0;", code):
            found.moves.append(targets[move[1]])
        elif stand := re.fullmatch(rf"WaitTime {number};", code):
            found.stood.append(float(stand[1]))
        elif say := re.fullmatch(r'TPWrite "([^"]*)";', code):
            found.said.append(say[1])
        elif code == "Stop;":
            found.stops += 1
        else:
            assert re.fullmatch(rf"PROC \w+\(\)|VelSet {number},5000;|ENDPROC|ENDMODULE|", code), line
    return found


READERS = {"urscript": urscript, "krl": krl, "rapid": rapid}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(ARMS / "ur5e.yaml")


@pytest.mark.parametrize("to", READERS)
def test_forty_poses_come_back(robot: Robot, to: str, tmp_path: Path) -> None:
    poses = np.random.default_rng(1).uniform(robot.lower, robot.upper, (40, 6))
    write_plan(tmp_path / "plan.csv", robot, poses)
    (path,) = write_program(tmp_path / "plan.csv", robot, to, tmp_path / to, percent=15, settle=1.5)
    found = READERS[to](path.read_text(encoding="utf-8"))
    assert np.abs(np.array(found.moves) - poses).max() < 1e-8
    assert found.stood == [1.5] * 40
    assert found.said == [f"MEASURE {i + 1}" for i in range(40)]
    assert found.stops == 0
    # again, with approach and stops: over its own file, but not over somebody's
    (path,) = write_program(tmp_path / "plan.csv", robot, to, tmp_path / to, approach=2.0, wait=True)
    found = READERS[to](path.read_text(encoding="utf-8"))
    assert np.abs(np.array(found.moves[1::2]) - poses).max() < 1e-8
    came = np.degrees(np.array(found.moves[1::2]) - np.array(found.moves[::2]))
    room = poses - np.radians(2) >= robot.lower
    assert came == pytest.approx(np.where(room, 2.0, -2.0), abs=1e-6)
    assert found.stops == 40
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(RefusedError, match=path.name):
        write_program(tmp_path / "plan.csv", robot, to, tmp_path / to)
    assert path.read_text(encoding="utf-8") == "mine"


@settings(max_examples=25, deadline=None)
@given(st.lists(st.text(max_size=60), min_size=1, max_size=4, unique=True), st.integers(0, 2**32 - 1))
def test_names_of_poses_are_never_code(robot: Robot, names: list[str], seed: int) -> None:
    poses = np.random.default_rng(seed).uniform(robot.lower, robot.upper, (len(names), 6))
    for to, reader in READERS.items():
        for text in program_files(to, "p", visits(robot, names, poses)).values():
            assert np.abs(np.array(reader(text).moves) - poses).max() < 1e-8


def test_directions_of_a_plan_are_kept(robot: Robot, tmp_path: Path) -> None:
    heads = [*(f"q{i}_deg" for i in range(1, 7)), "q2_direction", "elbow_direction"]
    rows = [["10"] * 6 + ["-1", "1"], ["20"] * 6 + ["1", "0"]]
    path = tmp_path / "plan.csv"
    path.write_text("\n".join(",".join(row) for row in [heads, *rows]) + "\n", encoding="utf-8")
    (written,) = write_program(path, robot, "csv", tmp_path)
    lines = [line.split(",") for line in written.read_text(encoding="utf-8").splitlines()]
    assert lines[0][:4] == ["pose", "do", "q1_deg", "q2_deg"]
    assert [line[1] for line in lines[1:]] == ["approach", "measure"] * 2
    approach = np.array([[float(cell) for cell in line[2:8]] for line in lines[1::2]])
    assert approach == pytest.approx(np.array([[10, 12, 8, 10, 10, 10], [20, 18, 20, 20, 20, 20]]))


def test_the_robot_of_a_plan(configs: Path, tmp_path: Path) -> None:
    plan = tmp_path / "plan.csv"
    with pytest.raises(InputError, match="there is no plan"):
        robot_of_plan(plan)
    plan.write_text("q1_deg\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"--robot.*say whose poses these are"):
        robot_of_plan(plan)
    given = configs / "robots" / "ur5.yaml"
    assert robot_of_plan(tmp_path, given)[1].name == load_robot(given).name
    text = (configs / "plan_position.yaml").read_text(encoding="utf-8")
    named = re.search(r"robot: (\S+)", text)
    assert named is not None
    beside = tmp_path / "experiment.resolved.yaml"
    beside.write_text(text.replace(named[1], str(configs / named[1])), encoding="utf-8")
    assert robot_of_plan(tmp_path)[0] == plan
    assert robot_of_plan(plan)[1].name == load_robot(configs / named[1]).name


@pytest.mark.parametrize("to", LANGUAGES)
def test_what_no_language_can_say(robot: Robot, to: str) -> None:
    pose = np.zeros((1, 6))
    for name in ("", "1st", "a b", "x" * 99, "ä"):
        with pytest.raises(InputError, match="no name of a program"):
            program_files(to, name, visits(robot, ["1"], pose))
    seven = load_robot(ARMS / "franka_fr3.yaml")
    drive = visits(seven, ["1"], (seven.lower + seven.upper)[None] / 2)
    if to == "csv":
        assert "q7_deg" in program_files(to, "p", drive)["p.csv"]
    else:
        with pytest.raises(RefusedError, match="not an arm of up to six revolute joints"):
            program_files(to, "p", drive)


def test_numbers_that_cannot_be(robot: Robot) -> None:
    for key, value in (("percent", 0.0), ("percent", 101.0), ("settle", -1.0), ("approach", np.nan)):
        with pytest.raises(InputError, match="out of range"):
            visits(robot, ["1"], np.zeros((1, 6)), **{key: value})
    with pytest.raises(RefusedError, match="pose 1 has joint elbow outside its limits"):
        visits(robot, ["1"], np.array([[0, 0, 4.0, 0, 0, 0]]))
