"""Images of a board by a small camera in an arm's hand, or of a board in it, as the tests of measuring want them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from cases import ARM as NAMELESS
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.camera.board import Board, parse_board
from symcal.camera.camera import Camera, in_image, project_points
from symcal.images.measure import flange_poses
from symcal.images.shots import Shot, Shots
from symcal.kernels import batch_function
from symcal.kinematics import chain, forward, frame_vector
from symcal.model.parameter_set import parameter_set
from symcal.vision.render import Look, render_board

LENS = Camera(480, 360, 460.0, 461.0, 241.0, 178.0, (-0.15, 0.03))
BOARD = parse_board("charuco:8x6:40mm:30mm:DICT_4X4_50")
LOOK = Look(noise=0.006)

ARM = replace(
    NAMELESS,
    links=tuple(replace(link, joint=replace(link.joint, name=f"j{i}")) for i, link in enumerate(NAMELESS.links)),
)

MIDDLE = np.array([0.3, -1.6, 1.9, -1.9, -1.6, 0.2])
"""Joint readings of the arm (rad) about which it looks at the board."""
T_FLANGE_CAMERA = spatial.transform(Rotation.from_rotvec([0.02, -0.03, 0.8]).as_matrix(), np.array([40.0, -25.0, 60.0]))


def true_flange(q: np.ndarray, rng: np.random.Generator, mm: float = 1.0, mrad: float = 4.0) -> np.ndarray:
    """T_base_flange of an arm with errors in all parameters, shape (N, 4, 4)."""
    parameters = parameter_set(ARM)
    x = np.array([rng.normal() * (mm if unit == "mm" else 1e-3 * mrad) for unit in parameters.units])
    return batch_function(forward(chain(ARM, parameters)), evaluations=0)(q, x, frame_vector(np.eye(4), np.eye(4)))[0]


@dataclass(frozen=True)
class Views:
    """Joint readings (N, 6), true T_camera_board (N, 4, 4), and image points (N, n, 2), NaN outside the image."""

    q: np.ndarray
    poses: np.ndarray
    pixels: np.ndarray


def views(
    count: int,
    rng: np.random.Generator,
    *,
    board: Board = BOARD,
    lens: Camera = LENS,
    spread: float = 0.35,
    least: float = 0.5,
    hand: bool = True,
) -> Views:
    """Random views of a board about 400 mm before the camera, of which at least a share of the points is seen."""
    centre = board.points.mean(axis=0)
    turned = np.diag([1.0, board.facing * -1.0, board.facing * -1.0])  # its printed side to the camera
    front = spatial.transform(turned, np.array([0.0, 0.0, 400.0]) - turned @ centre)
    middle = flange_poses(ARM, MIDDLE[None])[0]
    q = MIDDLE + rng.uniform(-spread, spread, (400 * count, 6))
    flange = true_flange(q, rng)
    if hand:
        fixed = middle @ T_FLANGE_CAMERA @ front
        poses = spatial.inverse(flange @ T_FLANGE_CAMERA) @ fixed
    else:  # the board in the hand, the camera in front of it
        fixed = middle @ T_FLANGE_CAMERA @ spatial.inverse(front)
        poses = spatial.inverse(fixed) @ flange @ T_FLANGE_CAMERA
    points = np.einsum("nij,kj->nki", poses[:, :3, :3], board.points) + poses[:, None, :3, 3]
    pixels = project_points(lens, points)
    seen = in_image(lens, pixels, 5.0)
    facing = -board.facing * poses[:, 2, 2] > 0.6
    far = np.linalg.norm(poses[:, :3, 3], axis=1) < 700
    good = np.flatnonzero((seen.mean(axis=1) >= least) & facing & far)[:count]
    assert len(good) == count
    return Views(q[good], poses[good], np.where(seen[..., None], pixels, np.nan)[good])


def images(found: Views, rng: np.random.Generator, *, board: Board = BOARD, lens: Camera = LENS) -> list[np.ndarray]:
    return [render_board(lens, board, pose, rng, LOOK) for pose in found.poses]


def shots(q: np.ndarray, pictures: list[np.ndarray]) -> Shots:
    """Images in their order at joint readings in theirs."""
    made = [
        Shot(f"{i:02d}.png", str(i), "train", joints, lambda picture=picture: picture)
        for i, (joints, picture) in enumerate(zip(q, pictures, strict=True))
    ]
    return Shots.of(made)
