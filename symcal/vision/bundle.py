"""Bundle adjustment: camera and poses together, and the board's points too where it is not flat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.camera.camera import Camera
from symcal.errors import RefusedError
from symcal.vision.precision import Pose, projected, view_jacobians

Float = NDArray[np.float64]

_State = tuple[Camera, list[Pose], list[Float]]

_STEPS = 50
_ROUNDING = 1e-13  # of a sum of squares


def free_coordinates(board: Board) -> NDArray[np.bool_]:
    """Coordinates of the board's points that can be estimated, shape (n, 3).

    Seven stay: the first point, the last one of its row (with it the scale), and the height of the very last point.
    """
    row_end = {"charuco": board.columns - 2, "aprilgrid": 2 * board.columns - 1}.get(board.kind, board.columns - 1)
    free = np.ones(board.points.shape, dtype=bool)
    free[[0, row_end]] = False
    free[-1, 2] = False
    return free


def adjust(
    camera: Camera,
    poses: Sequence[Pose],
    points: Sequence[Float],
    pixels: Sequence[Float],
    free: NDArray[np.bool_],
    free_points: NDArray[np.bool_] | None = None,
) -> tuple[Camera, list[Pose], list[Float]]:
    """Camera, poses and points that minimise the squared reprojection errors, by Gauss-Newton from a start nearby.

    In each step the poses are eliminated view by view; a step is halved until the errors shrink.

    Args:
        camera: the start. poses: likewise, one per view.
        points: in the board frame, one array per view, shape (n, 3), mm. pixels: their images, shape (n, 2), px.
        free: which of `NUMBER_NAMES` are estimated, shape (10,); the others stay as they are.
        free_points: which coordinates of the points are estimated too, shape (n, 3): then every view shows the same.
    Returns:
        camera, poses, points of every view.
    Raises:
        RefusedError: no convergence.
    Source: [Strobl2011] for the points; OpenCV has that as calibrateCameraRO, which by default fails an assertion in
    version 5.0.
    """
    state: _State = (camera, list(poses), list(points))
    cost, settled = _cost(state, pixels), False
    for _ in range(_STEPS):
        blocks = [view_jacobians(state[0], *at, free, free_points) for at in zip(*state[1:], strict=True)]
        errors = [residuals.ravel() for residuals in _residuals(state, pixels)]
        reduced = [(a - q @ (q.T @ a), e - q @ (q.T @ e)) for (q, _, a), e in zip(blocks, errors, strict=True)]
        stack, right = np.concatenate([a for a, _ in reduced]), np.concatenate([e for _, e in reduced])
        scale = np.maximum(np.linalg.norm(stack, axis=0), np.finfo(float).tiny)
        step = np.linalg.lstsq(stack / scale, right, rcond=None)[0] / scale
        moves = [np.linalg.lstsq(r, q.T @ (e - a @ step))[0] for (q, r, a), e in zip(blocks, errors, strict=True)]
        share, new, new_cost = 2.0, state, np.inf
        while new_cost > cost * (1 + _ROUNDING) and share > 1e-6:
            share /= 2
            new = _moved(state, free, free_points, share * step, [share * move for move in moves])
            new_cost = _cost(new, pixels)
        if new_cost > cost * (1 + _ROUNDING):
            return state
        # The cost is flat at its minimum: a step that no longer lowers it still moves closer.
        last, settled = settled, cost - new_cost <= 1e-12 * cost
        state, cost = new, new_cost
        if last and settled:
            return state
    raise RefusedError("the views do not determine the camera (or the shape of the board): take more, tilted")


def _residuals(state: _State, pixels: Sequence[Float]) -> list[Float]:
    camera, poses, points = state
    rows = zip(poses, points, pixels, strict=True)
    return [image - projected(camera, pose, xyz) for pose, xyz, image in rows]


def _cost(state: _State, pixels: Sequence[Float]) -> float:
    return float(sum(np.sum(residuals**2) for residuals in _residuals(state, pixels)))


def _moved(
    state: _State, free: NDArray[np.bool_], free_points: NDArray[np.bool_] | None, step: Float, moves: Sequence[Float]
) -> _State:
    """The state after a step of the shared unknowns, points first, and a move of every pose."""
    camera, poses, points = state
    count = int(free.sum())
    numbers = camera.numbers
    numbers[free] += step[-count:]
    numbers[:2] = np.maximum(numbers[:2], 1e-6)  # a focal length stays positive: such a step costs too much
    if free_points is not None:
        shape = points[0].copy()
        shape[free_points] += step[:-count]
        points = [shape] * len(points)
    turned = [(pose[0] + move[:3], pose[1] + move[3:]) for pose, move in zip(poses, moves, strict=True)]
    return camera.with_numbers(numbers), turned, points
