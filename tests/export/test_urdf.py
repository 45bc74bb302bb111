"""URDF in and out, against pinocchio, which reads URDF by itself (urdfdom) and knows no link parameters."""

from __future__ import annotations

import math
from dataclasses import replace
from importlib.metadata import distribution
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from decisions import ACCEPTED
from hypothesis import given
from hypothesis import strategies as st

from symcal import spatial
from symcal.errors import InputError, RefusedError
from symcal.export.urdf import roll_pitch_yaw, save_urdf, urdf_text
from symcal.kinematics import chain, forward, frame_vector
from symcal.model.parameter_set import parameter_set
from symcal.parameters import ParameterSet
from symcal.robot.conventions import convert, craig_robot
from symcal.robot.files import load_robot
from symcal.robot.robot import Joint, Record, Robot
from symcal.robot.urdf import load_urdf

SCARA = """<?xml version="1.0"?>
<robot name="scara">
  <link name="base"/><link name="l1"/><link name="l2"/><link name="l3"/><link name="l4"/><link name="tip"/>
  <joint name="j1" type="revolute">
    <origin xyz="0.01 -0.02 0.4" rpy="0.001 0 0.3"/><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
    <limit lower="-2.5" upper="2.5" effort="1" velocity="4"/>
  </joint>
  <joint name="j2" type="continuous">
    <origin xyz="0.325 0 0.05" rpy="0.002 -0.001 0"/><parent link="l1"/><child link="l2"/><axis xyz="0 0 -2"/>
  </joint>
  <joint name="j3" type="prismatic">
    <origin xyz="0.225 0.01 0"/><parent link="l2"/><child link="l3"/><axis xyz="0 0.01 -1"/>
    <limit lower="-0.02" upper="0.3" effort="1" velocity="0"/>
  </joint>
  <joint name="j4" type="revolute">
    <origin rpy="0 0 1.5707963"/><parent link="l3"/><child link="l4"/>
    <limit lower="-3" upper="3" effort="1" velocity="9"/>
  </joint>
  <joint name="end" type="fixed">
    <origin xyz="0 0.03 -0.1" rpy="3.14 0 0"/><parent link="l4"/><child link="tip"/>
  </joint>
</robot>
"""
GANTRY = """<robot name="gantry">
  <link name="base"/><link name="x"/><link name="y"/><link name="z"/><link name="head"/>
  <joint name="x" type="prismatic">
    <origin xyz="0 1 2"/><parent link="base"/><child link="x"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="3" effort="1" velocity="2"/>
  </joint>
  <joint name="y" type="prismatic">
    <origin xyz="0.1 0 0"/><parent link="x"/><child link="y"/><axis xyz="0.001 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="2"/>
  </joint>
  <joint name="z" type="prismatic">
    <origin xyz="0 0 -0.3"/><parent link="y"/><child link="z"/><axis xyz="0 0 -1"/>
    <limit lower="0" upper="0.8" effort="1" velocity="2"/>
  </joint>
  <joint name="turn" type="revolute">
    <origin xyz="0.02 0 0" rpy="0.1 0.2 0.3"/><parent link="z"/><child link="head"/><axis xyz="1 1 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="2"/>
  </joint>
</robot>
"""
ARMS = {  # the package's file, base, tip; or a text above
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "base_link", "tool0"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_link0", "panda_hand_tcp"),
    "tiago": ("tiago_description/robots/tiago.urdf", "base_link", "arm_tool_link"),
    "talos": ("talos_data/robots/talos_full_v2.urdf", "base_link", "gripper_left_base_link"),
    "baxter": ("baxter_description/urdf/baxter.urdf", "base", "left_gripper"),
    "kinova": ("kinova_description/robots/kinova.urdf", "base", "j2s6s200_end_effector"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link_base", "link_eef"),
    "scara": (SCARA, "base", "tip"),
    "gantry": (GANTRY, "base", "head"),
}


@pytest.fixture(params=ARMS)
def arm(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, str, str]:
    source, base, tip = ARMS[request.param]
    if not source.endswith(".urdf"):
        path = tmp_path / "arm.urdf"
        path.write_text(source)
        return path, base, tip
    path = Path(
        str(distribution("example-robot-data").locate_file(f"cmeel.prefix/share/example-robot-data/robots/{source}"))
    )
    assert path.is_file()
    return path, base, tip


def readings(robot: Robot, rng: np.random.Generator, count: int = 50) -> np.ndarray:
    lower = np.where(np.isfinite(robot.lower), robot.lower, -7.0)
    upper = np.where(np.isfinite(robot.upper), robot.upper, 7.0)
    return rng.uniform(lower, upper, (count, robot.dof))


def poses(robot: Robot, q: np.ndarray, *, base: bool = True) -> np.ndarray:
    function = forward(chain(robot, ParameterSet(())))
    frames = frame_vector(robot.base if base else np.eye(4), robot.tool)
    return np.array([np.array(function(row, [], frames)[0]) for row in q])


def witness(path: Path, base: str, tip: str, robot: Robot, q: np.ndarray) -> np.ndarray:
    """Pinocchio's poses of tip in base, in mm, for readings by joint name."""
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    out = []
    for row in q:
        state = pin.neutral(model)
        for joint, value in zip(robot.joints, row, strict=True):
            place = model.joints[model.getJointId(joint.name)]
            if place.nq == 2:
                state[place.idx_q : place.idx_q + 2] = math.cos(value), math.sin(value)
            else:
                state[place.idx_q] = value if joint.revolute else value / 1000
        pin.framesForwardKinematics(model, data, state)
        relative = data.oMf[model.getFrameId(base)].inverse() * data.oMf[model.getFrameId(tip)]
        out.append(spatial.transform(relative.rotation, relative.translation * 1000))
    return np.array(out)


def assert_same(a: np.ndarray, b: np.ndarray) -> None:
    np.testing.assert_allclose(a[:, :3, 3], b[:, :3, 3], rtol=0, atol=1e-9)
    angles = [np.linalg.norm(pin.log3(x.T @ y)) for x, y in zip(a[:, :3, :3], b[:, :3, :3], strict=True)]
    assert max(angles) < 1e-12


def test_import_agrees_with_pinocchio(arm: tuple[Path, str, str], rng: np.random.Generator) -> None:
    robot = load_urdf(*arm)
    q = readings(robot, rng)
    assert_same(poses(robot, q), witness(*arm, robot, q))


def test_export_round_trip_and_pinocchio(arm: tuple[Path, str, str], rng: np.random.Generator, tmp_path: Path) -> None:
    robot = load_urdf(*arm)
    robot = robot.corrected({name: 0.01 * rng.standard_normal() for name in robot.parameters})
    q = readings(robot, rng)
    for world in (False, True):
        out, root = tmp_path / "out.urdf", "world" if world else "base_link"
        save_urdf(robot, out, world=world)
        again = load_urdf(out, root, "tool")
        assert_same(poses(again, q), poses(robot, q, base=world))
        assert_same(witness(out, root, "tool", robot, q), poses(robot, q, base=world))
    for before, after in zip(robot.joints, again.joints, strict=True):
        assert (after.name, after.kind) == (before.name, before.kind)
        limits = (before.lower, before.upper, before.speed or 0)
        known = before.speed is not None  # an unknown speed comes back as the large number that stands for it
        np.testing.assert_allclose((after.lower, after.upper, after.speed if known else 0), limits, rtol=1e-14)


def test_readings_survive_export(configs: Path, rng: np.random.Generator, tmp_path: Path) -> None:
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    links = list(robot.links)
    links[0] = replace(links[0], joint=replace(links[0].joint, sign=-1, offset=0.3))
    links[2] = replace(links[2], joint=replace(links[2].joint, sign=-1, offset=-40.0))
    robot = replace(robot, links=tuple(links))
    save_urdf(robot, tmp_path / "r.urdf")
    q = readings(robot, rng)
    assert_same(witness(tmp_path / "r.urdf", "base_link", "tool", robot, q), poses(robot, q))
    links[3] = replace(links[3], joint=replace(links[3].joint, ratio=2.0))
    with pytest.raises(RefusedError, match="elbow has ratio 2"):
        urdf_text(replace(robot, links=tuple(links)))
    links[3] = robot.links[3]
    links[1] = replace(links[1], joint=replace(links[1].joint, lower=-math.inf, upper=math.inf))
    with pytest.raises(RefusedError, match="lift is prismatic without limits"):
        urdf_text(replace(robot, links=tuple(links)))


def test_names_stay_names(configs: Path, tmp_path: Path) -> None:
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    names = ['"; rm -rf', "base", "日本", "<&>", "flange_to_tool"]
    links = tuple(replace(k, joint=replace(k.joint, name=n)) for k, n in zip(robot.links, names, strict=True))
    save_urdf(replace(robot, links=links), tmp_path / "r.urdf")
    again = load_urdf(tmp_path / "r.urdf", "base_link", "tool")
    assert [joint.name for joint in again.joints] == names


def walk(placements: list[np.ndarray], joints: list[Joint], q: np.ndarray) -> np.ndarray:
    """The chain as it is defined, A_0 J_1 A_1 ...: upper three rows of the tool's pose at each row of q."""
    pose = np.tile(placements[0], (len(q), 1, 1))
    for joint, value, constant in zip(joints, q.T, placements[1:], strict=True):
        motion = np.tile(np.eye(4), (len(q), 1, 1))
        if joint.revolute:
            motion[:, :3, :3] = spatial.rpy_matrix(value[:, None] * [0.0, 0.0, 1.0])
        else:
            motion[:, 2, 3] = value
        pose = pose @ motion @ constant
    return pose[:, :3]


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("shape", ["RRR", "RPR", "PRR", "RRP", "PPP", "RPPR"])
def test_listed_parameters_span_the_general_model(shape: str, parallel: bool, rng: np.random.Generator) -> None:
    """Any small change of any placement is a change of listed parameters, base and tool, and the other way round."""
    joints = [Joint("revolute" if kind == "R" else "prismatic", f"j{i}") for i, kind in enumerate(shape)]
    angles = np.zeros((len(shape) + 1, 3)) if parallel else rng.uniform(0.3, 1.2, (len(shape) + 1, 3))
    constant = [spatial.transform(spatial.rpy_matrix(a), rng.uniform(50, 300, 3)) for a in angles]
    robot = craig_robot("arm", joints, constant)
    q = rng.uniform(-1, 1, (20, robot.dof)) * np.where([joint.revolute for joint in joints], 2.0, 300.0)
    np.testing.assert_allclose(poses(robot, q)[:, :3], walk(constant, joints, q), atol=1e-9)
    columns = []
    for index in range(len(constant)):
        for axis in range(6):
            step = 1e-3 if axis < 3 else 1e-5
            twist = step * np.eye(6)[axis]
            small = spatial.transform(spatial.rpy_matrix(twist[3:]), twist[:3])
            ends = []
            for change in (small, spatial.inverse(small)):
                changed = [c @ change if k == index else c for k, c in enumerate(constant)]
                ends.append(walk(changed, joints, q).ravel())
            columns.append((ends[0] - ends[1]) / (2 * step))
    model = chain(robot, parameter_set(robot))
    listed = ca.jacobian(model.tool[:3, :].T.reshape((-1, 1)), model.x)
    jacobian = ca.Function("j", [model.q, model.x, model.frames], [listed])
    ours = np.vstack([jacobian(row, 0, frame_vector(robot.base, robot.tool)).full() for row in q])
    everything = np.array(columns).T
    ours = np.hstack([ours, everything[:, :6], everything[:, -6:]])  # with the base's and the tool's six
    assert rank(ours) == rank(everything) == rank(np.hstack([ours, everything]))


def rank(matrix: np.ndarray) -> int:
    scaled = matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
    return int(np.linalg.matrix_rank(scaled, tol=1e-5))


def test_convert_is_exact_and_returns(configs: Path, rng: np.random.Generator) -> None:
    robot = load_robot(configs / "robots" / "handling_robot.yaml")
    robot = robot.corrected({name: 0.02 * rng.standard_normal() for name in robot.parameters})
    q = readings(robot, rng)
    craig = convert(robot, "craig")
    assert_same(poses(craig, q), poses(robot, q))
    assert_same(poses(convert(craig, "standard"), q), poses(robot, q))
    assert craig.parameters["alpha_3"] == robot.parameters["alpha_2"]
    assert "a_5" not in convert(craig, "standard").parameters  # it went to the tool


def test_convert_takes_the_calibration_along(configs: Path) -> None:
    nominal = load_robot(configs / "robots" / "handling_robot.yaml")

    def calibrated(errors: dict[str, float]) -> Robot:
        n = len(errors)
        record = Record(errors, dict.fromkeys(errors, 1e-3), 1e-6 * np.eye(n), nominal.base, nominal.tool, ACCEPTED)
        return replace(nominal.corrected(errors), record=record)

    craig = convert(calibrated({"alpha_1": 0.003, "d_4": 0.2, "beta_3": 0.001}), "craig")
    assert craig.record is not None
    assert craig.record.errors == {"alpha_2": 0.003, "d_4": 0.2, "beta_4": 0.001}
    q = np.array([[0.3, 1000.0, 200.0, 1.0, 0.5]])
    assert_same(poses(craig.nominal(), q), poses(nominal, q))
    with pytest.raises(RefusedError, match="a_5 would have to be said of a tool frame"):
        convert(calibrated({"a_5": 0.024}), "craig")


@given(st.tuples(*[st.sampled_from([0.0, 1e-9, 0.3, math.pi / 2, math.pi / 2 - 1e-8, math.pi, -math.pi / 2])] * 3))
def test_roll_pitch_yaw_is_exact_in_gimbal_lock(angles: tuple[float, float, float]) -> None:
    matrix = spatial.rpy_matrix(np.array(angles))
    np.testing.assert_allclose(spatial.rpy_matrix(roll_pitch_yaw(matrix)), matrix, atol=4e-16 * 4)


def joint(text: str) -> str:
    head = '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>'
    return f'{head}\n<joint name="j" {text}<parent link="a"/><child link="b"/></joint></robot>'


LIMIT = '<limit lower="-1" upper="1" effort="0" velocity="1"/>'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<robot", "not valid XML"),
        ("", "not valid XML"),
        ("not xml", "not valid XML"),
        ('<!DOCTYPE r [<!ENTITY x "y">]><robot/>', "document type"),
        ("<sdf/>", "outermost element must be 'robot'"),
        ('<robot xmlns:xacro="x"><xacro:include/></robot>', "xacro"),
        ('<robot><link name="a"/></robot>', "no link of this name"),
        ('<robot><link name="a"/><link name="b"/></robot>', "does not hang on 'a'"),
        (joint(f'type="floating">{LIMIT}'), "cannot have a joint of this type"),
        (joint(f'type="planar">{LIMIT}'), "cannot have a joint of this type"),
        (joint(f'type="revolute"><mimic joint="k"/>{LIMIT}'), "mimics another"),
        (joint('type="revolute">'), "needs a 'limit'"),
        (joint('type="revolute"><limit lower="1" upper="1"/>'), "leave no motion"),
        (joint(f'type="revolute"><axis xyz="0 0 0"/>{LIMIT}'), "cannot be zero"),
        (joint(f'type="revolute"><origin xyz="1 2"/>{LIMIT}'), "must be 3 finite numbers"),
        (joint(f'type="revolute"><origin xyz="1 nan 2"/>{LIMIT}'), "must be 3 finite numbers"),
        (joint(f'type="revolute"><origin xyz="1 x 2"/>{LIMIT}'), "must be 3 finite numbers"),
        (joint('type="fixed">'), "no joint moves"),
        (joint(f'type="revolute">{LIMIT}').replace("</robot>", joint('type="fixed">')[59:]), "child of two joints"),
    ],
)
def test_bad_files_are_refused_with_a_word(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.urdf"
    path.write_text(text)
    with pytest.raises(InputError, match=says):
        load_urdf(path, "a", "b")


def test_direction_and_loops_are_told(tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(SCARA)
    with pytest.raises(InputError, match="other way round"):
        load_urdf(path, "tip", "base")
    with pytest.raises(InputError, match="no such file"):
        load_urdf(tmp_path / "absent.urdf", "a", "b")
    loop = '<joint name="k" type="fixed"><parent link="tip"/><child link="base"/></joint></robot>'
    path.write_text(
        SCARA.replace("</robot>", loop).replace('<link name="tip"/>', '<link name="tip"/><link name="far"/>')
    )
    with pytest.raises(InputError, match="does not hang on 'far'"):
        load_urdf(path, "far", "tip")
