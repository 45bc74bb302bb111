"""Compensation: with the truth known, where does the calibrated robot's tool go?

The truth is walked by SciPy's rotations from the link tables alone; only the symbolic model knows CasADi.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from arms_with_terms import six_axis
from cases import TABLE_III
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.compensation.compensate import (
    CAPS,
    DAMPING,
    LEVER,
    REACHED,
    compensate,
    compensation_step,
    joint_caps,
    solve_definite,
    write_joints,
)
from symcal.compensation.targets import commanded, joint_columns, read_targets, tool_pose, wanted
from symcal.errors import InputError, RefusedError
from symcal.robot.files import load_robot
from symcal.robot.robot import ELEMENTS, Record, Robot, is_angle


def calibrated(robot: Robot, errors: dict[str, float]) -> Robot:
    n = len(errors)
    record = Record(errors, dict.fromkeys(errors, 1e-3), 1e-6 * np.eye(n), robot.base, robot.tool)
    return replace(robot.corrected(errors), record=record)


def walk(robot: Robot, q: np.ndarray) -> np.ndarray:
    """T_base_tool at each row of readings, shape (N, 4, 4)."""
    pose = np.tile(np.eye(4), (len(q), 1, 1))
    for link, value in zip(robot.links, q.T, strict=True):
        joint = link.joint
        for kind, axis in ELEMENTS[robot.convention]:
            amount = np.full(len(q), link.parameters.get(kind, 0.0))
            if kind == ("theta" if joint.revolute else "d"):
                amount = amount + joint.sign * joint.ratio * value + joint.offset
            motion = np.tile(np.eye(4), (len(q), 1, 1))
            if is_angle(kind):
                motion[:, :3, :3] = Rotation.from_rotvec(amount[:, None] * np.eye(3)[axis]).as_matrix()
            else:
                motion[:, axis, 3] = amount
            pose = pose @ motion
    return pose @ robot.tool


def missed(robot: Robot, q: np.ndarray, goal: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(walk(robot, q)[:, :3, 3] - goal[:, :3, 3], axis=1))


@pytest.fixture(scope="module")
def handling() -> Robot:
    robot = load_robot(Path(__file__).parents[1] / "configs" / "robots" / "handling_robot.yaml")
    return calibrated(robot, TABLE_III)


def puma(rng: np.random.Generator, geared: bool = False) -> Robot:
    robot = six_axis(geared)
    return calibrated(
        robot,
        {name: rng.normal() * (1e-3 if is_angle(name[:-2]) else 0.3) for name in robot.parameters},
    )


def test_table_iii_over_table_ii(handling: Robot, rng: np.random.Generator) -> None:
    joints = rng.uniform(handling.lower, handling.upper, (10_000, 5))
    goal = walk(handling.nominal(), joints)
    result = compensate(handling, commanded(handling, joints), rng)
    before, after = missed(handling, joints, goal), missed(handling, result.joints, goal)
    assert 4.25 < before.mean() < 4.4
    assert before.max() < 5.9
    np.testing.assert_allclose(result.uncompensated_mm, before, atol=1e-9)
    np.testing.assert_allclose(result.residual_mm, after, atol=1e-9)
    assert np.mean(after < REACHED) > 0.99
    assert (after <= before).all()
    assert (result.joints >= handling.lower).all()
    assert (result.joints <= handling.upper).all()
    assert (np.abs(result.joints - joints) <= joint_caps(handling) + 1e-12).all()
    margin = joint_caps(handling)
    free = ((joints > handling.lower + margin) & (joints < handling.upper - margin)).all(axis=1)
    assert (after[free] < REACHED).all()
    status = np.array(result.status)
    assert set(status[after > REACHED]) == {"joint limit"}
    assert (status[after <= REACHED] == "reached").all()
    at_stop = (result.joints == handling.lower) | (result.joints == handling.upper)
    assert (result.limiting & at_stop)[status == "joint limit"].any(axis=1).all()


def test_through_the_singularity(handling: Robot, rng: np.random.Generator) -> None:
    """d_3 + d_4 -> 0: the first axis passes through the tool."""
    links = list(handling.links)
    links[2] = replace(links[2], joint=replace(links[2].joint, lower=-600.0, upper=0.0))
    robot = replace(handling, links=tuple(links))
    joints = rng.uniform(robot.lower, robot.upper, (3000, 5))
    joints[:1000, 2] = -300 + rng.normal(size=1000) * np.logspace(-10, 1, 1000)
    joints[:50, 2] = -300.0
    goal = walk(robot.nominal(), joints)
    result = compensate(robot, commanded(robot, joints), rng)
    assert np.isfinite(result.joints).all()
    assert (missed(robot, result.joints, goal) <= missed(robot, joints, goal)).all()
    assert {"reached", "cap"} <= set(result.status)


@pytest.mark.parametrize("geared", [False, True])
def test_full_pose_of_six_axes(geared: bool, rng: np.random.Generator) -> None:
    robot = puma(rng, geared)
    joints = rng.uniform(robot.lower, robot.upper, (1000, 6))
    goal = walk(robot.nominal(), joints)
    result = compensate(robot, commanded(robot, joints), rng)
    there = walk(robot, result.joints)
    angle = Rotation.from_matrix(there[:, :3, :3] @ goal[:, :3, :3].swapaxes(1, 2)).magnitude()
    distance = np.linalg.norm(there[:, :3, 3] - goal[:, :3, 3], axis=1)
    reached = np.array(result.status) == "reached"
    q = np.array([j.sign * j.ratio for j in robot.joints]) * joints + [j.offset for j in robot.joints]
    regular = (np.abs(np.sin(q[:, 4])) > 0.4) & (
        np.abs(np.cos(q[:, 2] + 0.1)) > 0.4
    )  # neither wrist nor elbow singular
    inside = (np.abs(joints) < robot.upper - joint_caps(robot)).all(axis=1)
    forward = np.hypot(goal[:, 0, 3], goal[:, 1, 3]) > 400  # nor the shoulder
    assert result.pose
    assert (regular & inside & forward).sum() > 200
    assert reached[regular & inside & forward].mean() > 0.99
    assert distance[reached].max() < 1e-6
    assert angle[reached].max() < 1e-8
    assert result.residual_rad is not None
    assert result.uncompensated_rad is not None
    np.testing.assert_allclose(result.residual_rad, angle, atol=1e-9)
    size = np.hypot(distance, LEVER * angle)
    assert (size <= np.hypot(result.uncompensated_mm, LEVER * result.uncompensated_rad) + 1e-9).all()


def test_positions_alone_leave_the_orientation(rng: np.random.Generator) -> None:
    robot = puma(rng)
    targets = commanded(robot, rng.uniform(-1, 1, (200, 6)))
    result = compensate(robot, targets, rng, pose=False)
    assert not result.pose
    assert result.residual_mm.max() < REACHED
    assert result.residual_rad is not None
    assert np.median(result.residual_rad) > 1e-4


@pytest.mark.parametrize("pose", [False, True])
def test_targets_without_joints(pose: bool, rng: np.random.Generator) -> None:
    robot = puma(rng)
    goal = walk(robot.nominal(), rng.uniform(robot.lower, robot.upper, (30, 6)))
    goal[0, :3, 3] = 5000.0  # nobody gets there
    result = compensate(robot, wanted(robot, goal if pose else goal[:, :3, 3]), rng)
    status = np.array(result.status)
    assert status[0] == "out of reach"
    assert "out of reach" not in status[1:]
    assert np.mean(status == "reached") > 0.8  # elsewhere the correction is at its cap
    assert missed(robot, result.joints, goal)[status == "reached"].max() < REACHED
    assert missed(robot.nominal(), result.nominal, goal)[1:].max() < REACHED


def test_world_targets_go_through_the_calibrated_base(handling: Robot, rng: np.random.Generator) -> None:
    base = spatial.transform(spatial.rpy_matrix(np.array([0.3, 1.0, -2.0])), np.array([1000.0, -2000.0, 300.0]))
    moved = replace(handling, base=base)
    joints = rng.uniform([-1, 900, 100, 0.5, -1], [1, 1300, 600, 2, 1], (20, 5))
    points = walk(handling.nominal(), joints)[:, :3, 3]
    in_world = points @ base[:3, :3].T + base[:3, 3]
    one = compensate(moved, wanted(moved, in_world, joints=joints, frame="world"), rng)
    other = compensate(handling, wanted(handling, points, joints=joints), rng)
    np.testing.assert_allclose(one.joints, other.joints, atol=1e-9)
    same = compensate(
        moved, commanded(moved, joints), rng
    )  # where the instrument saw the base never leaks into commands
    np.testing.assert_allclose(same.joints, other.joints, atol=1e-9)


def test_the_cap_is_told(handling: Robot, rng: np.random.Generator) -> None:
    joints = rng.uniform([-1, 900, 100, 0.5, -1], [1, 1300, 600, 2, 1], (20, 5))
    result = compensate(handling, commanded(handling, joints), rng, caps=(1e-4, 0.1))
    assert set(result.status) == {"cap"}
    assert (np.abs(result.joints - joints) <= joint_caps(handling, (1e-4, 0.1)) + 1e-12).all()
    assert (result.residual_mm < result.uncompensated_mm).all()
    assert result.table()["status"].str.startswith("cap: ").all()


def test_step_is_the_weighted_minimum_norm(handling: Robot) -> None:
    """Against NumPy's solution of the stacked least-squares problem, with a Jacobian from finite differences."""
    step = compensation_step(handling)
    assert step.name_in() == ["q", "target", "lower", "upper"]
    q = np.array([0.3, 1000.0, 200.0, 1.0, -0.5])
    target = walk(handling, q[None])[0, :3, 3] + [3.0, -2.0, 1.0]
    following, error = step(q, target, np.full(5, -np.inf), np.full(5, np.inf))
    h = 1e-5
    ends = [walk(handling, q + s * h * np.eye(5))[:, :3, 3] for s in (1, -1)]
    jacobian = ((ends[0] - ends[1]) / (2 * h)).T
    root = np.array([1 / 300 if joint.revolute else 1.0 for joint in handling.joints])
    stacked = np.vstack([jacobian * root, np.sqrt(DAMPING) * np.eye(5)])
    scaled = np.linalg.lstsq(stacked, np.r_[[3.0, -2.0, 1.0], np.zeros(5)])[0]
    np.testing.assert_allclose(error.full().ravel(), [3, -2, 1], atol=1e-9)
    np.testing.assert_allclose(following.full().ravel() - q, root * scaled, rtol=1e-6, atol=1e-9)


def test_three_steps_do_what_the_search_does(handling: Robot, rng: np.random.Generator) -> None:
    """The loop for a controller: three plain steps within limits and caps."""
    joints = rng.uniform([-2, 900, 50, 0.5, -2], [2, 1300, 650, 2, 2], (200, 5))
    goal = walk(handling.nominal(), joints)[:, :3, 3]
    step = compensation_step(handling).map(200)
    cap = joint_caps(handling)
    low, high = np.maximum(handling.lower, joints - cap).T, np.minimum(handling.upper, joints + cap).T
    q = joints.T
    for _ in range(3):
        q = step(q, goal.T, low, high)[0].full()
    assert np.linalg.norm(walk(handling, q.T)[:, :3, 3] - goal, axis=1).max() < REACHED


@given(arrays(np.float64, (6, 6), elements=st.floats(-10, 10)), arrays(np.float64, 6, elements=st.floats(-10, 10)))
def test_solve_definite(root: np.ndarray, right: np.ndarray) -> None:
    matrix = root @ root.T + np.eye(6)
    x = np.asarray(ca.evalf(solve_definite(ca.SX(matrix), ca.SX(right)))).ravel()
    np.testing.assert_allclose(matrix @ x, right, atol=1e-9)


def test_what_cannot_be_done_is_refused(handling: Robot, rng: np.random.Generator) -> None:
    with pytest.raises(RefusedError, match="fewer than six"):
        wanted(handling, np.eye(4)[None])
    targets = commanded(handling, np.array([[0, 1000, 100, 1, 0]]))
    with pytest.raises(RefusedError, match="a full pose takes six"):
        compensate(handling, targets, rng, pose=True)
    with pytest.raises(RefusedError, match="these targets are positions"):
        compensate(handling, wanted(handling, np.zeros((1, 3))), rng, pose=True)
    with pytest.raises(InputError, match="'lift' is outside its limits, 850 mm to 1350 mm"):
        commanded(handling, np.array([[0, 100, 100, 1, 0]]))
    with pytest.raises(InputError, match="shape"):
        commanded(handling, np.zeros((2, 4)))
    with pytest.raises(InputError, match="finite"):
        wanted(handling, np.array([[np.nan, 0, 0]]))


def test_targets_from_csv(handling: Robot, tmp_path: Path, rng: np.random.Generator) -> None:
    joints = rng.uniform(handling.lower, handling.upper, (7, 5))
    path = tmp_path / "joints.csv"
    pd.DataFrame(joint_columns(handling, joints)).to_csv(path, index=False)
    targets = read_targets(path, handling)
    assert targets.joints is not None
    np.testing.assert_allclose(targets.joints, joints, atol=1e-12)
    np.testing.assert_allclose(targets.poses, walk(handling.nominal(), joints), atol=1e-9)
    result = compensate(handling, targets, rng)
    write_joints(result, path)
    np.testing.assert_allclose(read_targets(path, handling).joints, result.joints, atol=1e-12)


def test_a_place_that_cannot_be_written_is_told(handling: Robot, tmp_path: Path, rng: np.random.Generator) -> None:
    result = compensate(handling, commanded(handling, np.array([[0, 1000, 100, 1, 0]])), rng)
    with pytest.raises(InputError, match="cannot be written"):
        write_joints(result, tmp_path / "absent" / "joints.csv")


def test_poses_from_csv(tmp_path: Path, rng: np.random.Generator) -> None:
    robot = puma(rng)
    pose = walk(robot.nominal(), rng.uniform(-1, 1, (4, 6)))
    written = spatial.matrix_pose(pose)
    path = tmp_path / "targets.csv"
    frame = pd.DataFrame(written / [1000, 1000, 1000, 1, 1, 1, 1], columns=[*"xyz", "qx", "qy", "qz", "qw"])
    frame.rename(columns={c: f"{c}_m" for c in "xyz"}).to_csv(path, index=False)
    np.testing.assert_allclose(read_targets(path, robot).poses, pose, atol=1e-9)
    angles = np.array([[10.0, 20.0, 30.0], [-170.0, 80.0, 5.0]])
    columns = ["x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg"]
    pd.DataFrame(np.hstack([np.ones((2, 3)), angles]), columns=columns).to_csv(path, index=False)
    np.testing.assert_allclose(
        read_targets(path, robot).poses[:, :3, :3],
        Rotation.from_euler("ZYX", angles[:, ::-1], degrees=True).as_matrix(),
        atol=1e-12,
    )


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("x_mm,y_mm,z_mm\n1,2,3\n1,two,3\n", 3, "not a finite number"),
        ("x_mm,y_mm,z_mm\n1,2,nan\n", 2, "not a finite number"),
        ("x,y,z\n1,2,3\n", 1, "has no unit"),
        ("x_mm,y_mm\n1,2\n", 1, "no column for the target's z"),
        ("a,b\n1,2\n", 1, "no targets"),
        ("q1_deg,q2_mm,q3_mm,q4_deg,q5_deg\n0,900,0,0,0\n0,0,0,0,0\n", 3, "'lift' is outside its limits"),
        ("q1_deg,q2_deg,q3_mm,q4_deg,q5_deg\n0,900,0,0,0\n", 1, "unit 'deg'"),
    ],
)
def test_rows_that_cannot_be_read(handling: Robot, text: str, line: int, says: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=says) as caught:
        read_targets(path, handling)
    assert caught.value.line == line


def test_tool_pose_is_in_the_base_frame(handling: Robot) -> None:
    moved = replace(handling, base=spatial.transform(np.eye(3), np.ones(3)))
    q = np.array([np.pi / 4, 1100.0, 0.0, np.pi / 2, 0.0])
    np.testing.assert_allclose(tool_pose(moved)(q).full(), walk(handling, q[None])[0], atol=1e-9)
    expected = [-229.81, 194.454, 1100.0]  # worked out by hand for the nominal robot of [Ding2017]
    np.testing.assert_allclose(tool_pose(moved.nominal())(q).full()[:3, 3], expected, atol=5e-3)


def test_caps_default() -> None:
    geared = six_axis(geared=True)
    np.testing.assert_allclose(joint_caps(geared), CAPS[0] / np.arange(50.0, 56.0))


def test_large_zero_offsets_widen_the_caps(handling: Robot) -> None:
    """A found offset of 1.5 deg is what compensation is for; the cap against nonsense must let it through."""
    found = calibrated(handling, {"theta_4": np.deg2rad(1.5)})
    assert joint_caps(handling) == pytest.approx([0.02, 10.0, 10.0, 0.02, 0.02])
    assert joint_caps(found) == pytest.approx([3 * np.deg2rad(1.5), 10.0, 10.0, *[3 * np.deg2rad(1.5)] * 2])
    absurd = calibrated(handling, {"d_2": 400.0})
    assert joint_caps(absurd) == pytest.approx([0.02, 50.0, 50.0, 0.02, 0.02])
