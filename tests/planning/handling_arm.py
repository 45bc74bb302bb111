"""The handling robot with a camera in front of it, and its geometry written out by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from symcal.camera.camera import Camera
from symcal.camera.target import Target
from symcal.kinematics import Chain, chain
from symcal.model.measurement import Setup
from symcal.model.parameter_set import parameter_set
from symcal.planning.camera_view import CameraView, camera_view, look_at
from symcal.robot.files import load_robot
from symcal.robot.robot import Robot

ROBOT = Path(__file__).resolve().parents[2] / "configs" / "robots" / "handling_robot.yaml"


def handling_chain() -> Chain:
    robot = load_robot(ROBOT)
    return chain(robot, parameter_set(robot))


def own_setup(robot: Robot) -> Setup:
    return Setup(robot.base, robot.tool)


def front_view(made: Chain) -> CameraView:
    mount = np.eye(4)
    mount[:3, :3] = Rotation.from_euler("y", 45, degrees=True).as_matrix()
    mount[:3, 3] = (10.0, -5.0, 40.0)
    camera = Camera(2448, 2048, 4638.0, 4600.0, 1223.5, 1023.5)
    T_world_camera = look_at(np.array([300.0, 3000.0, 1200.0]), np.array([0.0, 500.0, 1100.0]))
    return camera_view(made, own_setup(made.robot), camera, T_world_camera, Target.triangle(200, 15), mount)


def transform_by_hand(theta: float, d: float, alpha: float) -> np.ndarray:
    """Rz(theta) Tz(d) Rx(alpha), the only motions of the handling robot."""
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("z", theta).as_matrix() @ Rotation.from_euler("x", alpha).as_matrix()
    out[2, 3] = d
    return out


def frames_by_hand(q: np.ndarray) -> list[np.ndarray]:
    """T_world_i of the five links, from Table I."""
    half = np.pi / 2
    rows = [(q[0], 0, 0), (0, q[1], -half), (0, q[2], 0), (q[3], 300, -half), (q[4], 25, 0)]
    frames = [np.eye(4)]
    for row in rows:
        frames.append(frames[-1] @ transform_by_hand(*row))
    return frames[1:]
