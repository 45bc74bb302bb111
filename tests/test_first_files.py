"""First files as a newcomer meets them: every instrument's pass the check, and their tables are what is read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from init_pairs import tried
from scipy.spatial.transform import Rotation

from symcal.config.conversion import load_experiment
from symcal.data.measurement_file import load_measurements
from symcal.drafts.cell import cell
from symcal.drafts.instrument import DRAFTS, draft_named
from symcal.drafts.robot_file import of_arm
from symcal.errors import InputError
from symcal.images.shots import read_shots
from symcal.robot.arms import arm_file, arm_names
from symcal.robot.files import load_robot
from symcal.robot.urdf import load_urdf

SCARA = """<robot name="scara">
  <link name="base"/><link name="arm"/><link name="forearm"/><link name="quill"/><link name="tip"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 0 1"/><limit lower="-2.3" upper="2.3" velocity="6"/></joint>
  <joint name="elbow" type="revolute"><parent link="arm"/><child link="forearm"/>
    <origin xyz="0.325 0 0"/><axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" velocity="6"/></joint>
  <joint name="lift" type="prismatic"><parent link="forearm"/><child link="quill"/>
    <origin xyz="0.275 0 0" rpy="3.141592653589793 0 0"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.2" velocity="1"/></joint>
  <joint name="spin" type="revolute"><parent link="quill"/><child link="tip"/>
    <origin xyz="0 0 0.05"/><axis xyz="0 0 1"/><limit lower="-3.1" upper="3.1" velocity="9"/></joint>
</robot>
"""


def made(symcal, folder: Path, arm: str, instrument: str) -> Path:
    if arm == "scara":
        (folder / "scara.urdf").write_text(SCARA)
        given = ("--from", "scara.urdf")
    else:
        given = ("--arm", arm)
    code, _, err = symcal("init", *given, "--instrument", instrument, "--out", "first", "--quiet")
    assert (code, err) == (0, "")
    return folder / "first"


@pytest.mark.parametrize(
    ("arm", "instrument"),
    [("ur5e", name) for name in DRAFTS] + [("scara", name) for name in DRAFTS if name != "fixed-camera"],
)
def test_what_is_written_is_checked_and_its_table_is_read(symcal, tmp_path, arm, instrument):
    folder = made(symcal, tmp_path, arm, instrument)
    code, out, err = symcal("check", folder / "experiment.yaml")
    assert (code, err) == (0, "")
    assert "parameter directions can be seen" in out
    draft, robot = DRAFTS[instrument], load_robot(folder / "robot.yaml")
    table = folder / draft.table
    head = table.read_text().strip().split(",")
    text = {"pose": "first", "image": "first.png", draft.by: next(iter(draft.entries), "")}
    row = [text.get(name) or ("1" if name == "qw" else "0") for name in head]
    table.write_text(f"{','.join(head)}\n{','.join(row)}\n")
    if draft.images:
        (shot,) = read_shots(table, robot, [Path("first.png")]).shots
        assert shot.q.shape == (robot.dof,)
    else:
        data = load_measurements(table, robot, draft.kind, where=dict([(draft.by, row[1])] if draft.by else []))
        assert data.q.shape == (1, robot.dof)
        assert not [note for note in data.notes if "column" in note]


@pytest.mark.parametrize("instrument", DRAFTS)
def test_guesses_are_marked_and_lie_within_the_limits(symcal, tmp_path, instrument):
    folder = made(symcal, tmp_path, "franka_fr3", instrument)
    file, _ = load_experiment(folder / "experiment.yaml")
    robot, lines = load_robot(folder / "robot.yaml"), (folder / "experiment.yaml").read_text().splitlines()
    for joint in robot.joints:
        low, high = np.deg2rad(file.plan.area[joint.name])
        assert joint.lower - 1e-9 <= low < high <= joint.upper + 1e-9
    for word in ("near:", "area:", "tilt:", "radius:", "planes:"):
        assert all("# FILL IN" in line for line in lines if f" {word}" in line)
    assert not [line for line in lines if len(line) > 120 and not line.startswith("data:")]


def test_an_arm_of_the_list_is_as_it_stands_there(symcal, tmp_path):
    folder = made(symcal, tmp_path, "ur5e", "tracker")
    assert load_robot(folder / "robot.yaml").parameters == load_robot(arm_file("ur5e")).parameters


def test_a_urdf_is_the_same_arm(symcal, tmp_path):
    folder = made(symcal, tmp_path, "scara", "wire")
    ours, theirs = load_robot(folder / "robot.yaml"), load_urdf(tmp_path / "scara.urdf", "base", "tip")
    assert ours.parameters == pytest.approx(theirs.parameters, abs=1e-12)
    np.testing.assert_allclose(ours.tool, theirs.tool, atol=1e-9)


def test_an_arm_whose_tool_hangs_down_is_refused_a_camera_that_would_not_see_it(symcal, tmp_path):
    code, _, err = symcal("init", "--arm", "denso_hsr065", "--instrument", "fixed-camera")
    assert code == 1
    assert "the tool of 'denso_hsr065' cannot point level and away from the arm" in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arm", "instrument"), [("denso_hsr065", "board"), ("denso_hsr065", "socket"), ("ur5e", "board")]
)
def test_a_pair_is_ready_for_a_plan(tmp_path, arm, instrument):
    """Short form of `python tests/init_pairs.py`; the tool of this SCARA has its z axis up, into the arm."""
    found = tried(of_arm(arm), DRAFTS[instrument], tmp_path)
    assert not found.refused
    assert found.seen >= 8
    assert found.share > 0.1


@pytest.mark.long
@pytest.mark.parametrize("instrument", DRAFTS)
@pytest.mark.parametrize("arm", arm_names())
def test_every_pair_is_ready_for_a_plan_or_refused(tmp_path, arm, instrument):
    found = tried(of_arm(arm), DRAFTS[instrument], tmp_path)
    assert "cannot point" in found.refused if found.refused else found.share > 0.1


def test_a_camera_in_the_hand_looks_down_at_its_board_and_a_standing_one_stands_upright():
    ur5e, scara = (load_robot(arm_file(name)) for name in ("ur5e", "denso_hsr065"))
    for robot in (ur5e, scara):
        board = frame(cell(robot, DRAFTS["board"]).places["place"])
        assert board[2, 2] < -0.9  # z into the board: it is seen from above
        assert board[2, 3] < 150.0
    camera = frame(cell(ur5e, DRAFTS["fixed-camera"]).places["place"])
    assert camera[2, 1] < -0.9  # y down in its images


def frame(text: str) -> np.ndarray:
    said = yaml.safe_load(text)
    turn = Rotation.from_euler("xyz", said["rpy"], degrees=True).as_matrix()
    return np.block([[turn, np.array(said["xyz"])[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])


def test_a_plan_with_a_board_is_chosen_from_a_sample(symcal, tmp_path):
    folder = made(symcal, tmp_path, "ur5e", "board")
    small = ("sample=150", "random=0", "poses=12")
    options = [word for each in small for word in ("--set", f"plan.{each}")]
    quick = ("--set", "outputs.report=false", "--set", "outputs.figures=false")
    code, _, err = symcal("plan", folder / "experiment.yaml", *options, *quick, "--out", "planned")
    assert (code, err) == (0, "")
    found = json.loads((tmp_path / "planned" / "results.json").read_text())
    assert found["plan"]["certificate"]["exhaustive"]
    assert (found["pool"] >= 150, found["touching"], found["promise"]) == (True, False, None)


def test_a_plan_works_at_once(symcal, tmp_path):
    folder = made(symcal, tmp_path, "scara", "wire")
    small = ("sample=300", "random=0", "method=random", "promise.counts=[30]", "promise.random=1", "poses=30")
    options = [word for each in small for word in ("--set", f"plan.{each}")]
    code, _, err = symcal("plan", folder / "experiment.yaml", *options, "--out", "planned")
    assert (code, err) == (0, "")
    assert len((tmp_path / "planned" / "plan.csv").read_text().splitlines()) == 31


@pytest.mark.parametrize(("arm", "instrument"), [("ur5e", "tracker"), ("scara", "wire")])
def test_a_simulation_is_accepted_at_once(symcal, tmp_path, arm, instrument):
    folder = made(symcal, tmp_path, arm, instrument)
    code, out, err = symcal("run", folder / "experiment.yaml", "--no-report", "--out", "simulated")
    assert (code, err) == (0, "")
    assert "accepted" in out


def test_nothing_is_replaced(symcal, tmp_path):
    folder = made(symcal, tmp_path, "ur5e", "tracker")
    (folder / "experiment.yaml").unlink()
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    code, _, err = symcal("init", "--arm", "ur5e", "--instrument", "wire", "--out", "first")
    assert code == 1
    assert "first/robot.yaml is there already, and nothing is replaced" in err
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--arm", "ur5ee", "--instrument", "tracker"), "did you mean 'ur5e'?"),
        (("--arm", "ur5e", "--instrument", "traker"), "did you mean 'tracker'?"),
        (("--instrument", "tracker"), "say which arm"),
        (("--arm", "ur5e"), "say what measures the arm"),
        (("--arm", "ur5e", "--tip", "tool0"), "about a URDF file"),
    ],
)
def test_what_is_missing_or_unknown_is_one_sentence(symcal, tmp_path, arguments, words):
    code, _, err = symcal("init", *arguments)
    assert code == 1
    assert words in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_the_list_shows_arms_and_instruments(symcal):
    code, out, _ = symcal("init", "--list")
    assert code == 0
    for word in ("ur5e", "Universal Robots", "two agree", "one only", *DRAFTS):
        assert word in out


def test_a_kind_stands_for_its_first_instrument():
    assert draft_named("position").name == "tracker"
    with pytest.raises(InputError, match="no first files"):
        draft_named("direction")
