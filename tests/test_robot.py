"""Robot files: what goes out comes back in, and what is wrong is said once, at its place."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import random_frame, robots

from symcal.errors import InputError
from symcal.robot.files import load_robot, save_robot
from symcal.robot.robot import Frame, Joint, Link, Record, Robot, is_angle

PAPER = """\
name: handling-robot
convention: standard
units: {length: mm, angle: deg}
links:
  - {joint: revolute,  name: waist, limits: [-165, 165], theta: 0, alpha: 0, beta: 0}
  - {joint: prismatic, name: lift,  limits: [850, 1350], d: 0, alpha: -90}
  - {joint: prismatic, name: reach, limits: [0, 700],    d: 0, alpha: 0, beta: 0}
  - {joint: revolute,  name: elbow, limits: [0, 175],    theta: 0, d: 300, a: 0, alpha: -90}
  - {joint: revolute,  name: wrist, limits: [-175, 175], theta: 0, d: 25,  a: 0}
tool: {xyz: [1, 2, 3], rpy: [0, 0, 90]}
scales: {alpha_2: 2, d_4: 3}
"""


@pytest.fixture
def write(tmp_path):
    def to_file(text: str) -> Path:
        path = tmp_path / "robot.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return to_file


def refused(path: Path) -> InputError:
    with pytest.raises(InputError) as caught:
        load_robot(path)
    assert caught.value.file == path
    assert "\n" not in str(caught.value)
    return caught.value


def test_the_paper_s_robot(write):
    robot = load_robot(write(PAPER))
    assert (robot.name, robot.convention, robot.dof) == ("handling-robot", "standard", 5)
    assert [joint.name for joint in robot.joints] == ["waist", "lift", "reach", "elbow", "wrist"]
    assert [joint.revolute for joint in robot.joints] == [True, False, False, True, True]
    np.testing.assert_allclose(robot.lower, [*np.radians([-165]), 850, 0, 0, np.radians(-175)])
    np.testing.assert_allclose(robot.upper, [np.radians(165), 1350, 700, np.radians(175), np.radians(175)])
    # the error parameters of the paper's Table III, in its order
    names = "theta_1 theta_4 theta_5 alpha_1 alpha_2 alpha_3 alpha_4 a_4 a_5 d_2 d_3 d_4 d_5 beta_1 beta_3"
    assert list(robot.parameters) == names.split()
    assert robot.parameters["alpha_2"] == pytest.approx(-math.pi / 2)
    assert robot.parameters["d_4"] == 300
    assert robot.scales == {"alpha_2": pytest.approx(math.radians(2)), "d_4": 3.0}
    np.testing.assert_allclose(robot.tool, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-15)
    np.testing.assert_array_equal(robot.base, np.eye(4))
    # what the links can add up to, the tool included
    assert robot.reach == pytest.approx(1350 + 700 + 300 + 25 + math.sqrt(14))
    assert robot.nominal() is robot


def test_the_same_robot_in_other_units(write):
    metres = PAPER
    for old, new in [
        ("{length: mm, angle: deg}", "{length: m, angle: mrad}"),
        ("[-165, 165]", f"[{-math.radians(165) * 1e3}, {math.radians(165) * 1e3}]"),
        ("[850, 1350]", "[0.85, 1.35]"),
        ("[0, 700]", "[0, 0.7]"),
        ("[0, 175]", f"[0, {math.radians(175) * 1e3}]"),
        ("[-175, 175]", f"[{-math.radians(175) * 1e3}, {math.radians(175) * 1e3}]"),
        ("alpha: -90", f"alpha: {-math.pi / 2 * 1e3}"),
        ("d: 300", "d: 0.3"),
        ("d: 25", "d: 0.025"),
        ("[1, 2, 3], rpy: [0, 0, 90]", f"[0.001, 0.002, 0.003], rpy: [0, 0, {math.pi / 2 * 1e3}]"),
        ("{alpha_2: 2, d_4: 3}", f"{{alpha_2: {math.radians(2) * 1e3}, d_4: 0.003}}"),
    ]:
        assert old in metres
        metres = metres.replace(old, new)
    assert_same(load_robot(write(metres)), load_robot(write(PAPER)), 1e-12)


def test_joint_as_a_controller_has_it(write):
    path = write(PAPER.replace("name: wrist,", "name: wrist, sign: -1, ratio: 0.5, offset: 90, speed: 180,"))
    wrist = load_robot(path).joints[4]
    assert (wrist.sign, wrist.ratio) == (-1, 0.5)
    assert wrist.offset == pytest.approx(math.pi / 2)
    assert wrist.speed == pytest.approx(math.pi)


def test_what_may_be_left_out(write):
    text = (
        "name: r\nconvention: craig\nunits: {length: m, angle: rad}\nlinks: [{joint: prismatic}, {joint: revolute}]\n"
    )
    robot = load_robot(write(text))
    assert [joint.name for joint in robot.joints] == ["joint_1", "joint_2"]
    assert robot.parameters == {}
    assert np.isneginf(robot.lower).all()
    assert np.isposinf(robot.upper).all()
    assert robot.record is None


def test_frames():
    roll = Frame(xyz=[1.0, 2.0, 3.0], rpy=[90.0, 0.0, 0.0]).matrix(1000.0, math.pi / 180)
    quat = Frame(xyz=[1.0, 2.0, 3.0], quat_xyzw=[math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]).matrix(1000.0, 1.0)
    np.testing.assert_allclose(roll, [[1, 0, 0, 1000], [0, 0, -1, 2000], [0, 1, 0, 3000], [0, 0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(quat, roll, atol=1e-15)


def assert_same(a: Robot, b: Robot, tolerance: float) -> None:
    close = {"rtol": tolerance, "atol": tolerance}
    assert (a.name, a.convention, a.dof) == (b.name, b.convention, b.dof)
    for one, other in zip(a.joints, b.joints, strict=True):
        assert (one.kind, one.name, one.sign) == (other.kind, other.name, other.sign)
        numbers = [[j.lower, j.upper, j.ratio, j.offset, j.speed or 0.0] for j in (one, other)]
        np.testing.assert_allclose(*numbers, **close)
    for mine, theirs in ((a.parameters, b.parameters), (a.scales, b.scales)):
        assert list(mine) == list(theirs)
        np.testing.assert_allclose(list(mine.values()), list(theirs.values()), **close)
    np.testing.assert_allclose(a.base, b.base, **close)
    np.testing.assert_allclose(a.tool, b.tool, **close)
    assert (a.record is None) == (b.record is None)
    if a.record is not None and b.record is not None:
        assert (a.record.errors, a.record.sigmas) == (b.record.errors, b.record.sigmas)
        assert a.record.provenance == b.record.provenance
        np.testing.assert_array_equal(a.record.covariance, b.record.covariance)
        np.testing.assert_allclose(a.record.nominal_base, b.record.nominal_base, **close)
        np.testing.assert_allclose(a.record.nominal_tool, b.record.nominal_tool, **close)


@given(
    robot=robots, length=st.sampled_from(["mm", "m", "um", "cm", "in"]), angle=st.sampled_from(["deg", "rad", "mrad"])
)
def test_what_is_saved_is_loaded(tmp_path, robot, length, angle):
    path = tmp_path / "saved.yaml"
    save_robot(robot, path, (length, angle))
    assert_same(load_robot(path), robot, 1e-12)


@settings(max_examples=10)
@given(robot=robots)
def test_a_second_save_writes_the_same_robot(tmp_path, robot):
    save_robot(robot, tmp_path / "a.yaml", ("m", "rad"))
    save_robot(load_robot(tmp_path / "a.yaml"), tmp_path / "b.yaml")
    assert_same(load_robot(tmp_path / "b.yaml"), robot, 1e-12)


def test_a_saved_file_names_its_schema_and_lists_only_what_there_is(tmp_path, write):
    path = tmp_path / "saved.yaml"
    save_robot(load_robot(write(PAPER)), path)
    data = yaml.safe_load(path.read_text())
    assert data["schema"] == "symcal/robot/1"
    assert data["units"] == {"length": "mm", "angle": "deg"}
    lift = {"joint": "prismatic", "name": "lift", "limits": [850.0, 1350.0], "alpha": pytest.approx(-90), "d": 0.0}
    assert data["links"][1] == lift
    assert "calibration" not in data


def test_an_identified_robot_keeps_its_numbers_however_odd(tmp_path):
    # numbers as an identification returns them (NumPy), an angle that a divergent fit wound up, radians-like degrees
    link = Link(Joint("revolute", "a"), {"theta": np.float64(40.0), "alpha": np.float64(math.radians(1.5708))})
    record = Record({"theta_1": 40.0}, {"theta_1": None}, np.zeros((1, 1)), np.eye(4), np.eye(4))
    robot = Robot("odd", "craig", (link,), record=record)
    save_robot(robot, tmp_path / "odd.yaml")
    assert_same(load_robot(tmp_path / "odd.yaml"), robot, 1e-12)


def test_corrected_and_nominal_are_inverse(write, rng):
    robot = load_robot(write(PAPER))
    errors = {name: float(rng.normal()) for name in robot.parameters}
    base, tool = random_frame(rng), random_frame(rng)
    moved = robot.corrected(errors)
    assert moved.parameters == {name: value + errors[name] for name, value in robot.parameters.items()}
    n = len(errors) + 1
    record = Record(errors | {"base_x": 1.0}, {}, np.zeros((n, n)), robot.base, robot.tool)
    calibrated = replace(moved, base=base, tool=tool, record=record)
    assert_same(calibrated.nominal(), robot, 1e-13)
    with pytest.raises(KeyError):
        robot.corrected({"theta_2": 0.1})


def test_is_angle():
    assert [is_angle(kind) for kind in ("theta", "alpha", "a", "d", "beta")] == [True, True, False, False, True]


def test_robots_compare_by_identity(write):
    path = write(PAPER)
    robot = load_robot(path)
    assert robot == robot
    assert robot != load_robot(path)
    assert len({robot, robot}) == 1


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "found", "words"),
    [
        ("convention:", "convension:", 2, "convension", "convension", "did you mean 'convention'?"),
        ("convention: standard", "convention: dh", 2, "convention", "dh", "allowed: standard, craig"),
        ("convention: standard\n", "", 1, "convention", None, "missing; allowed: standard, craig"),
        ("units: {length: mm, angle: deg}\n", "", 1, "units", None, "missing"),
        ("length: mm, ", "", 3, "units.length", None, "missing; allowed: mm, m, um, cm, in"),
        ("angle: deg", "angle: degrees", 3, "units.angle", "degrees", "did you mean 'deg'? allowed: deg, rad, mrad"),
        ("beta: 0}", "betta: 0}", 5, "links[0].betta", "betta", "did you mean 'beta'?"),
        ("joint: prismatic", "joint: linear", 6, "links[1].joint", "linear", "allowed: revolute, prismatic"),
        ("joint: prismatic, ", "", 6, "links[1].joint", None, "allowed: revolute, prismatic"),
        ("d: 300", "d: 300 mm", 8, "links[3].d", "300 mm", "number"),
        ("d: 300", "d: .nan", 8, "links[3].d", "nan", "NaN"),
        ("d: 300", "d: 300,5", 8, "links[3].5", "5", "unknown key"),
        ("d: 300", "d:", 8, "links[3].d", None, "leave the key out"),
        ("d: 300", "d: 300, d: 3", 8, "links[3].d", None, "twice"),
        ("name: lift", "name:", 6, "links[1].name", None, "leave the key out"),
        ("name: lift", "name: waist", 6, "links[1].name", "waist", "two joints"),
        ("name: lift", "name: q1", 6, "links[1].name", "q1", "belongs to joint 1"),
        ("limits: [0, 700]", "limits: [700, 0]", 7, "links[2].limits", "[700, 0]", "lower < upper"),
        ("limits: [0, 700]", "limits: [700]", 7, "links[2].limits", "[700]", "at least 2"),
        ("limits: [0, 700]", "limits: 700", 7, "links[2].limits", "700", "list"),
        ("limits: [0, 700]", "limits: [0, .inf]", 7, "links[2].limits[1]", "inf", "finite"),
        ("limits: [0, 700]", "limits:", 7, "links[2].limits", None, "leave the key out"),
        ("d: 300", "sign: 2", 8, "links[3].sign", "2", "allowed: 1, -1"),
        ("d: 300", "ratio: 0", 8, "links[3].ratio", "0", "not be zero"),
        ("d: 300", "speed: 0", 8, "links[3].speed", "0", "greater than 0"),
        ("rpy: [0, 0, 90]", "rpy: [0, 0]", 10, "tool.rpy", "[0, 0]", "at least 3"),
        ("rpy: [0, 0, 90]", "rpz: [0, 0, 90]", 10, "tool.rpz", "rpz", "did you mean 'rpy'?"),
        ("rpy: [0, 0, 90]", "rpy: [0, 0, 1], quat_xyzw: [0, 0, 0, 1]", 10, "tool", None, "not both"),
        ("rpy: [0, 0, 90]", "quat_xyzw: [0, 0, 0, 2]", 10, "tool.quat_xyzw", "[0, 0, 0, 2]", "unit quaternion"),
        ("alpha_2: 2", "alpha_9: 2", 11, "scales.alpha_9", "alpha_9", "did you mean 'alpha_4'?"),
        ("alpha_2: 2", "alpha_2: -2", 11, "scales.alpha_2", "-2", "greater than 0"),
        ("name: handling", "schema: symcal/robot/9\nname: handling", 1, "schema", "symcal/robot/9", "symcal/robot/1"),
        # the unit that the numbers are evidently in is not the one that the file says
        ("angle: deg", "angle: rad", 5, "links[0].limits", "[-165.0, 165.0]", "ten turns"),
        ("alpha: -90}", "alpha: -1.5708}", 6, "links[1].alpha", "-1.5708", "looks like -90 deg written in rad"),
        ("rpy: [0, 0, 90]", "rpy: [3.1416, 0, 0]", 10, "tool.rpy[0]", "3.1416", "looks like 180 deg written in rad"),
        ("alpha: -90}", "alpha: -5157}", 6, "links[1].alpha", "-5157.0", "two turns"),
    ],
)
def test_each_mistake_is_one_error_at_its_place(write, old, new, line, key, found, words):
    assert old in PAPER
    error = refused(write(PAPER.replace(old, new, 1)))
    assert (error.line, error.key, error.found) == (line, key, found)
    assert words in str(error)


def test_a_joint_without_a_name_has_one_that_is_taken(write):
    text = PAPER.replace("name: waist", "name: joint_2")
    assert load_robot(write(text)).joints[0].name == "joint_2"
    error = refused(write(text.replace("name: lift, ", "")))
    assert (error.line, error.key, error.found) == (6, "links[1].name", "joint_2")


def test_degrees_in_a_file_that_says_rad_even_without_limits(write):
    text = PAPER.replace("angle: deg", "angle: rad")
    for limits in ("limits: [-165, 165], ", "limits: [0, 175],    ", "limits: [-175, 175], "):
        text = text.replace(limits, "")
    error = refused(write(text))
    assert (error.line, error.key) == (6, "links[1].alpha")
    assert "more than two turns" in str(error)


def test_an_angle_near_a_multiple_of_pi_is_not_always_a_slip(write):
    # 355 is 113 pi to 3e-5
    assert load_robot(write(PAPER.replace("alpha: -90}", "alpha: 355}"))).parameters["alpha_2"] > 6


CALIBRATION = """\
calibration:
  errors: {alpha_2: 0.01, base_x: 0.5}
  sigmas: {alpha_2: 0.001, base_x: null}
  covariance: [[1.0e-6, 0], [0, 0]]
  nominal_base: {xyz: [0, 0, 0]}
  nominal_tool: {xyz: [0, 0, 0]}
"""


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "words"),
    [
        ("[[1.0e-6, 0], [0, 0]]", "[[1, 0]]", 15, "calibration.covariance", "2 x 2"),
        ("[[1.0e-6, 0], [0, 0]]", "[[1, .nan], [0, 0]]", 15, "calibration.covariance[0][1]", "NaN"),
        ("errors: {alpha_2", "errors: {alpha_5", 13, "calibration.errors.alpha_5", "no such parameter"),
        ("sigmas: {alpha_2", "sigmas: {alpha_3", 14, "calibration.sigmas.alpha_3", "did you mean 'alpha_2'?"),
        ("  nominal_tool: {xyz: [0, 0, 0]}\n", "", 12, "calibration.nominal_tool", "missing"),
    ],
)
def test_a_damaged_calibration(write, old, new, line, key, words):
    assert load_robot(write(PAPER + CALIBRATION)).record.sigmas == {"alpha_2": 0.001, "base_x": None}
    assert old in CALIBRATION
    error = refused(write(PAPER + CALIBRATION.replace(old, new)))
    assert (error.line, error.key) == (line, key)
    assert words in str(error)


def test_joints_have_two_limits_or_none():
    Joint("revolute", "a", -1.0, 1.0)
    for lower, upper in ((0.0, math.inf), (-math.inf, 0.0), (1.0, 1.0), (2.0, 1.0), (math.nan, 1.0)):
        with pytest.raises(InputError, match="limits"):
            Joint("revolute", "a", lower, upper)


def test_saving_where_nothing_can_be_saved(write, tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        save_robot(load_robot(write(PAPER)), tmp_path / "no" / "such" / "folder.yaml")


def test_shipped_robots_load(configs):
    files = sorted((configs / "robots").glob("*.yaml"))
    assert files
    for file in files:
        robot = load_robot(file)
        assert Rotation.from_matrix(robot.base[:3, :3]).magnitude() <= math.pi
        assert robot.reach > 100
