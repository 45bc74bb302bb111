"""A handling robot in front of a camera, as the tests of pixel measurements want it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from cases import TABLE_III
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.camera.camera import Camera, in_image, project_points
from symcal.camera.target import Target
from symcal.model.measurement import Setup
from symcal.model.model import Model, build_model
from symcal.model.task import Scene, pixels_task
from symcal.placing.scene_placement import flange_poses
from symcal.robot.files import load_robot
from symcal.robot.robot import Robot

ROBOT: Robot = load_robot(Path(__file__).parents[1] / "configs" / "robots" / "handling_robot.yaml")

TRUTH = TABLE_III
"""Errors of the robot: Table III of the paper, mm and rad."""


def camera(covariance: bool = True) -> Camera:
    """5 Mpx behind a 16 mm lens, some distortion, known as well as some thirty views of a board let one know it."""
    sigma = np.array([0.3, 0.3, 0.4, 0.4, 2e-4, 1e-3, 1e-5, 1e-5, 0.0])
    mixed = np.diag(sigma) @ (0.6 * np.eye(9) + 0.4) @ np.diag(sigma) if covariance else None
    return Camera(2448, 2048, 4637.0, 4638.5, 1230.2, 1018.7, (-0.08, 0.11, 2e-4, -1e-4), mixed)


def target(side: float = 200.0, mount: bool = True) -> Target:
    """Equal discs, tilted by 60 deg on the flange."""
    frame = spatial.transform(Rotation.from_euler("y", 60, degrees=True).as_matrix(), np.array([60.0, 10, 80]))
    return Target.triangle(side, 25.0, mount=frame if mount else None)


T_WORLD_CAMERA = spatial.transform(
    np.column_stack([[-1.0, 0, 0], [0, 0, -1], [0, -1, 0]]), np.array([100.0, 2700.0, 1150.0])
)
"""In front of the robot's working area, looking back at it."""


def visible(model: Model, q: np.ndarray, largest: float = 60.0) -> np.ndarray:
    """Poses (mask) whose points are all in the image and face the camera, at nominal."""
    scene, setup = model.task.scene, model.setup
    poses = spatial.inverse(setup.places["camera"]) @ flange_poses(model, q) @ setup.tool
    points = np.einsum("nij,kj->nki", poses[:, :3, :3], scene.target.points) + poses[:, None, :3, 3]
    normal = poses[:, :3, :3] @ np.array(scene.target.normal)
    cosine = -np.einsum("nki,ni->nk", points, normal) / np.linalg.norm(points, axis=2)
    seen = in_image(scene.camera, project_points(scene.camera, points), 30.0)
    return (seen & (cosine > np.cos(np.deg2rad(largest)))).all(axis=1)


def poses(model: Model, count: int, rng: np.random.Generator) -> np.ndarray:
    """Random visible poses of the robot's front half, shape (count, dof)."""
    found = []
    lower, upper = ROBOT.lower.copy(), ROBOT.upper.copy()
    lower[0], upper[0] = -np.pi / 2, np.pi / 2
    while sum(map(len, found)) < count:
        q = rng.uniform(lower, upper, (5000, ROBOT.dof))
        found.append(q[visible(model, q)])
    return np.concatenate(found)[:count]


def scene_model(**keywords: object) -> Model:
    """The model of the scene with camera and mount at their true places, all unknown."""
    return build_model(ROBOT, pixels_task(Scene(camera(), target(), T_WORLD_CAMERA), **keywords))


def small_camera() -> Camera:
    """A quarter of the pixels of `camera` behind the same lens, for images that are quickly rendered."""
    return Camera(1224, 1024, 2318.5, 2319.0, 614.8, 509.1, (-0.08, 0.11, 2e-4, -1e-4))


def target_poses(model: Model, q: np.ndarray, x: np.ndarray, setup: Setup) -> np.ndarray:
    """True T_camera_target of a robot with errors x at readings q, camera and mount as in ``setup``."""
    flange = model.flange(q, x, Setup(setup.base, setup.tool).vector)[0]
    return np.asarray(spatial.inverse(setup.places["camera"]) @ flange)
