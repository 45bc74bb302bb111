"""Masses of a URDF file: the gravity moments of the robot that is read are pinocchio's, whichever way it hangs."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import distribution
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from symcal.errors import InputError
from symcal.joints.arm import G
from symcal.joints.compliance import Compliance
from symcal.kinematics import bases
from symcal.robot.files import load_robot, save_robot
from symcal.robot.robot import Robot
from symcal.robot.urdf import load_urdf

ARMS = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "base_link", "tool0"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_link0", "panda_hand_tcp"),
    "tiago": ("tiago_description/robots/tiago.urdf", "base_link", "arm_tool_link"),
    "talos": ("talos_data/robots/talos_full_v2.urdf", "base_link", "gripper_left_base_link"),
    "kinova": ("kinova_description/robots/kinova.urdf", "base", "j2s6s200_end_effector"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link_base", "link_eef"),
}
GANTRY = """<robot name="gantry">
  <link name="base"><inertial><mass value="50"/></inertial></link><link name="x"/>
  <link name="plate"><inertial><origin xyz="0.1 0.2 0.3" rpy="1 0 0"/><mass value="3"/></inertial></link>
  <link name="head"><inertial><origin xyz="0 0.05 0.1"/><mass value="2"/></inertial></link>
  <link name="camera"><inertial><origin xyz="0.01 0 0"/><mass value="0.5"/></inertial></link>
  <joint name="tilt" type="fixed"><origin rpy="0.3 0.2 0.1"/><parent link="base"/><child link="x"/></joint>
  <joint name="lift" type="prismatic">
    <origin xyz="0 1 2" rpy="0.4 0 0"/><parent link="x"/><child link="plate"/><axis xyz="1 2 3"/>
    <limit lower="0" upper="3" effort="1" velocity="2"/>
  </joint>
  <joint name="turn" type="revolute">
    <origin xyz="0.02 0 0" rpy="0.1 0.2 0.3"/><parent link="plate"/><child link="head"/><axis xyz="1 1 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="2"/>
  </joint>
  <joint name="eye" type="fixed">
    <origin xyz="0 0 0.2" rpy="0 0.5 0"/><parent link="head"/><child link="camera"/>
  </joint>
</robot>
"""


def packaged(source: str) -> Path:
    place = f"cmeel.prefix/share/example-robot-data/robots/{source}"
    return Path(str(distribution("example-robot-data").locate_file(place)))


def moments(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Of gravity about the joints, N mm and N: what a compliance of one yields by."""
    terms = tuple(Compliance(i, joint.revolute) for i, joint in enumerate(robot.joints, start=1))
    return np.asarray(bases(replace(robot, terms=terms))(q)).ravel()


def witness(path: Path, base: str, robot: Robot, q: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Pinocchio's, with all other joints at zero and gravity along ``down`` of the base link."""
    model = pin.buildModelFromUrdf(str(path))
    data, state = model.createData(), pin.neutral(model)
    for joint, value in zip(robot.joints, q, strict=True):
        place = model.joints[model.getJointId(joint.name)]
        if place.nq == 2:
            state[place.idx_q : place.idx_q + 2] = np.cos(value), np.sin(value)
        else:
            state[place.idx_q] = value if joint.revolute else value / 1000
    pin.framesForwardKinematics(model, data, state)
    model.gravity.linear = G * data.oMf[model.getFrameId(base)].rotation @ down
    held = pin.computeGeneralizedGravity(model, data, state)  # what holds the arm: the opposite of gravity's moment
    place = [model.joints[model.getJointId(joint.name)].idx_v for joint in robot.joints]
    return -held[place] * np.where([joint.revolute for joint in robot.joints], 1000.0, 1.0)


@pytest.mark.parametrize("name", [*ARMS, "gantry"])
def test_gravity_moments_are_pinocchio_s(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    if name == "gantry":
        path, base, tip = tmp_path / "gantry.urdf", "base", "head"
        path.write_text(GANTRY)
    else:
        path, base, tip = packaged(ARMS[name][0]), *ARMS[name][1:]
    robot = load_urdf(path, base, tip)
    assert robot.masses
    save_robot(robot, tmp_path / "robot.yaml")
    robot = load_robot(tmp_path / "robot.yaml")  # the file keeps them
    turn = robot.base[:3, :3]
    for down in (np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, -0.8])):
        x, y, z = map(float, turn.T @ down)
        hung = replace(robot, down=(x, y, z))
        if down[2] == -1:
            np.testing.assert_allclose(hung.down, robot.down, atol=1e-15)
        for q in rng.uniform(*robot.ranges, (10, robot.dof)):
            expected = witness(path, base, robot, q, down)
            found = moments(hung, q)
            assert np.abs(expected).max() > 1
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("mass", "says"),
    [('value="-1"', "cannot be negative"), ('value="x"', "must be a finite number"), ('value="nan"', "finite number")],
)
def test_a_mass_that_is_none_is_refused(mass: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "gantry.urdf"
    path.write_text(GANTRY.replace('value="0.5"', mass))
    with pytest.raises(InputError, match=says) as caught:
        load_urdf(path, "base", "head")
    assert caught.value.line == 5
