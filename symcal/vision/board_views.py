"""Poses of a board from which a camera is well calibrated: tilted about all axes, and into all corners of the image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from symcal.camera.board import Board
from symcal.camera.camera import Camera, project_points
from symcal.errors import RefusedError
from symcal.spatial import transform

Float = NDArray[np.float64]

_TILT_DEG = (15.0, 45.0)
_ROLL_DEG = 25.0
_SIZE = (0.4, 0.75)  # the longer side of the board's image over the image's
_MARGIN_PX = 12.0
_TRIES = 400


def board_views(camera: Camera, board: Board, count: int, rng: np.random.Generator) -> Float:
    """Poses T_camera_board that show the whole board, shape (count, 4, 4), mm.

    Every view is tilted by 15 to 45 deg about a random axis and pushed towards one of nine places of the image in turn.

    Raises:
        RefusedError: no such view is found (a board or a lens out of the ordinary).
    """
    low, high = board.points.min(axis=0) - board.square, board.points.max(axis=0) + board.square
    corners = np.array([[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])])
    middle = corners.mean(axis=0)
    places = [(u, v) for v in (0.0, 0.5, 1.0) for u in (0.0, 0.5, 1.0)]
    views: list[Float] = []
    for _ in range(_TRIES * count):
        if len(views) == count:
            break
        pose = _view(camera, corners, middle, board.facing, places[len(views) % 9], rng)
        if pose is not None:
            views.append(pose)
    if len(views) < count:
        raise RefusedError(f"only {len(views)} of {count} views show the whole board")
    return np.array(views)


def _view(
    camera: Camera, corners: Float, middle: Float, facing: int, place: tuple[float, float], rng: np.random.Generator
) -> Float | None:
    """One pose near a place of the image (shares of its width and height), None if the board is not whole in it."""
    direction, tilt = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(*_TILT_DEG))
    turn = Rotation.from_rotvec(tilt * np.array([np.cos(direction), np.sin(direction), 0.0]))
    turn = turn * Rotation.from_euler("z", rng.uniform(-_ROLL_DEG, _ROLL_DEG), degrees=True)
    if facing > 0:
        turn = turn * Rotation.from_euler("x", 180, degrees=True)
    rotation = turn.as_matrix()
    size = rng.uniform(*_SIZE) * camera.width
    depth = camera.fx * float(np.ptp(corners[:, 0])) / size
    shift = np.zeros(2)
    extent = np.array([camera.width, camera.height])
    for _ in range(4):
        centre = np.array([*shift, depth])
        pixels = project_points(camera, (corners - middle) @ rotation.T + centre)
        if not np.isfinite(pixels).all():
            return None
        least, most = pixels.min(axis=0), pixels.max(axis=0)
        room = extent - 1 - 2 * _MARGIN_PX - (most - least)
        if np.any(room < 0):
            return None
        wanted = _MARGIN_PX + np.array(place) * room
        shift = shift + (wanted - least) * depth / np.array([camera.fx, camera.fy])
    centre = np.array([*shift, depth])
    pixels = project_points(camera, (corners - middle) @ rotation.T + centre)
    if not np.isfinite(pixels).all() or np.any(pixels < 0) or np.any(pixels > extent - 1):
        return None
    return transform(rotation, centre - rotation @ middle)
