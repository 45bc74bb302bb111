"""Random views of a board that show it whole."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from symcal.camera.board import Board
from symcal.camera.camera import Camera, in_image, project_points, rays


def placed(rotation: Rotation, point: np.ndarray, ray: np.ndarray, depth: float) -> np.ndarray:
    """T_camera_board with a point of the board on a ray (X/Z, Y/Z), at a depth in mm."""
    transform = np.eye(4)
    transform[:3, :3] = rotation.as_matrix()
    transform[:3, 3] = depth * np.array([*ray, 1.0]) - transform[:3, :3] @ point
    return transform


def board_views(
    camera: Camera,
    board: Board,
    count: int,
    rng: np.random.Generator,
    *,
    share: float = 0.6,
    margin: float | None = None,
) -> list[np.ndarray]:
    """T_camera_board, tilted by 10 to 40 deg, the board about `share` of the image's width, all points inside.

    margin: px between a point and the border, by default six tenths of the spacing (the dots of a grid are whole).
    """
    middle, size = board.points.mean(axis=0), np.ptp(board.points, axis=0)
    result: list[np.ndarray] = []
    while len(result) < count:
        depth = camera.fx * size[0] / (camera.width * share) * rng.uniform(0.9, 1.4)
        direction, tilt = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 0.7)
        tilted = Rotation.from_rotvec([tilt * np.cos(direction), tilt * np.sin(direction), 0])
        rotation = tilted * Rotation.from_rotvec([0, 0, rng.uniform(-0.4, 0.4)])
        if board.facing > 0:
            rotation = rotation * Rotation.from_rotvec([np.pi, 0, 0])
        pixel = np.array([camera.width, camera.height]) * rng.uniform(0.2, 0.8, 2)
        view = placed(rotation, middle, rays(camera, pixel), depth)
        pixels = project_points(camera, board.points @ view[:3, :3].T + view[:3, 3])
        edge = 0.6 * camera.fx * board.square / depth if margin is None else margin
        if np.all(in_image(camera, pixels, edge)):
            result.append(view)
    return result


def seen(camera: Camera, board: Board, view: np.ndarray) -> np.ndarray:
    """Image points of the board's points, shape (n, 2)."""
    return project_points(camera, board.points @ view[:3, :3].T + view[:3, 3])


def nearest_order(found: np.ndarray, indices: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Errors, in the better of the two orders that a board with a half-turn symmetry allows, shape (n, 2)."""
    errors = [found - true[indices], found - true[::-1][indices]]
    return min(errors, key=lambda e: float(np.abs(e).max()))
