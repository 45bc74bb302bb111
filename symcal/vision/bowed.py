"""Bundle adjustment with a board that is not flat: camera, poses and the board's points together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.camera.camera import Camera
from symcal.errors import RefusedError
from symcal.vision.precision import Pose, projected, view_jacobians

Float = NDArray[np.float64]

_STEPS = 50


def free_coordinates(board: Board) -> NDArray[np.bool_]:
    """Coordinates of the board's points that can be estimated, shape (n, 3).

    Seven stay: the first point, the last one of its row (with it the scale), and the height of the very last point.
    """
    row_end = board.columns - (2 if board.kind == "charuco" else 1)
    free = np.ones(board.points.shape, dtype=bool)
    free[[0, row_end]] = False
    free[-1, 2] = False
    return free


def adjust_bowed(
    camera: Camera, poses: Sequence[Pose], board: Board, pixels: Sequence[Float], free_k3: bool
) -> tuple[Camera, list[Pose], Float]:
    """Camera, poses and points of the board that minimise the squared reprojection errors, by Gauss-Newton.

    It starts from a flat fit. In each step the poses are eliminated view by view; a step is halved until the errors
    shrink.

    Args:
        camera: of the flat fit.
        poses: of the flat fit, one per view.
        board: every view shows all its points.
        pixels: one array per view, shape (n, 2), px.
        free_k3: whether k3 is estimated.
    Returns:
        camera, poses, points of the board, shape (n, 3), mm.
    Raises:
        RefusedError: no convergence.
    Source: [Strobl2011]. OpenCV has it as calibrateCameraRO, which by default fails an assertion in version 5.0.
    """
    free = free_coordinates(board)
    points, turns = board.points, list(poses)
    cost = _cost(camera, turns, points, pixels)
    for _ in range(_STEPS):
        blocks = [view_jacobians(camera, pose, points, free_k3, free) for pose in turns]
        errors = [(image - projected(camera, pose, points)).ravel() for pose, image in zip(turns, pixels, strict=True)]
        reduced = [(q, r, a, a - q @ (q.T @ a), e - q @ (q.T @ e)) for (q, r, a), e in zip(blocks, errors, strict=True)]
        stack, right = np.concatenate([b[3] for b in reduced]), np.concatenate([b[4] for b in reduced])
        scale = np.linalg.norm(stack, axis=0)
        step = np.linalg.lstsq(stack / scale, right, rcond=None)[0] / scale
        moves = [np.linalg.solve(r, q.T @ (e - a @ step)) for (q, r, a), e in zip(blocks, errors, strict=True)]
        share = 1.0
        while True:
            new = _moved(camera, turns, points, free, free_k3, share * step, [share * move for move in moves])
            new_cost = _cost(*new, pixels)
            if new_cost <= cost or share < 1e-6:
                break
            share /= 2
        if new_cost > cost or cost - new_cost <= 1e-12 * cost:
            return camera, turns, points
        (camera, turns, points), cost = new, new_cost
    raise RefusedError("the views do not determine the shape of the board: take more of them, tilted about both axes")


def _cost(camera: Camera, poses: Sequence[Pose], points: Float, pixels: Sequence[Float]) -> float:
    return float(sum(np.sum((i - projected(camera, p, points)) ** 2) for p, i in zip(poses, pixels, strict=True)))


def _moved(
    camera: Camera,
    poses: Sequence[Pose],
    points: Float,
    free: NDArray[np.bool_],
    free_k3: bool,
    step: Float,
    moves: Sequence[Float],
) -> tuple[Camera, list[Pose], Float]:
    shape = points.copy()
    shape[free] += step[: free.sum()]
    numbers = camera.intrinsics
    numbers[: 9 if free_k3 else 8] += step[free.sum() :]
    fx, fy, cx, cy, *dist = numbers.tolist()
    turned = [(pose[0] + move[:3], pose[1] + move[3:]) for pose, move in zip(poses, moves, strict=True)]
    return Camera(camera.width, camera.height, fx, fy, cx, cy, tuple(dist)), turned, shape
