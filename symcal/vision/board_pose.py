"""Where a board stands in the camera that sees it, and what its image says of the focal length."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.camera.camera import Camera, rays
from symcal.spatial import transform
from symcal.vision.board import BoardDetection

Float = NDArray[np.float64]

LEVER = 200.0
"""mm: how far from the board's middle its pose is judged."""

_ALIKE = 2.0  # a second pose whose rms is at most this multiple of the first one's cannot be told from it
_FLOOR_PX = 0.05  # rms below which nothing is concluded from its ratio
_SAME = 1e-3  # two starts that end this near each other, of mm and rad, ended at one pose
_UNTOLD = 1e12  # condition number of the scaled normal equations from which nothing is told
_STEPS = 20


@dataclass(frozen=True, slots=True)
class BoardPose:
    """The poses that one view allows.

    poses: T_camera_board, the likeliest first, shape (k, 4, 4), mm, k = 1 or 2: a small or far board looks the same
    tilted one way and the other. rms_px: reprojection error of the first, of the points' distances.
    sigma: rms standard deviation of the board's middle and of points at `LEVER` from it along its axes, mm.
    focal, focal_sigma: focal length over the camera's at which the view fits best, and its standard deviation, which is
    infinite where the view, seen head-on, says nothing. focal_rms_px: reprojection error at that focal length.
    """

    poses: Float
    rms_px: float
    sigma: float
    focal: float
    focal_sigma: float
    focal_rms_px: float


def board_pose(camera: Camera, board: Board, detection: BoardDetection) -> BoardPose | None:
    """The poses of a board from its points in one image; None where they give none.

    Source: the two poses of a plane in closed form [Collins2014], as OpenCV has it; refined to the image points here.
    """
    points = board.points[detection.indices]
    undistorted = rays(camera, detection.pixels)
    if not np.isfinite(undistorted).all():
        return None
    middle = points.mean(axis=0)
    count, turns, shifts, _ = cv2.solvePnPGeneric(
        points - middle, undistorted[:, None, :], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    found = []
    for turn, shift in zip(turns[:count], shifts[:count], strict=True):
        start = np.concatenate([np.ravel(turn), np.ravel(shift), [1.0]])
        refined = _fitted(camera, points - middle, detection.pixels, start, focal=False)
        if refined is not None:
            found.append(refined)
    if not found:
        return None
    found.sort(key=lambda each: each.rms)
    best = found[0]
    kept = [each.state for each in found if each.rms <= _ALIKE * max(best.rms, _FLOOR_PX)]
    if len(kept) == 2 and np.abs(kept[0] - kept[1]).max() < _SAME * max(1.0, float(np.abs(kept[0]).max())):
        kept.pop()
    free = _fitted(camera, points - middle, detection.pixels, best.state, focal=True)
    poses = np.array([_matrix(state, middle) for state in kept])
    if free is None:
        return BoardPose(poses, best.rms, _scatter(best), 1.0, np.inf, best.rms)
    focal, sigma = float(free.state[6]), float(np.sqrt(free.covariance[6, 6]))
    return BoardPose(poses, best.rms, _scatter(best), focal, sigma, free.rms)


@dataclass(frozen=True, slots=True)
class _Fitted:
    """Rotation vector, translation (of the points' middle) and focal ratio, shape (7,); rms, px; covariance (7, 7) at
    the scatter of the residuals, infinite where they say nothing."""

    state: Float
    rms: float
    covariance: Float


def _scatter(fitted: _Fitted) -> float:
    """Standard deviation of the middle and of three points around it, rms, mm."""
    by_turn = np.asarray(cv2.Rodrigues(fitted.state[:3])[1]).reshape(3, 3, 3)  # turn's component, row, column
    arms = np.vstack([np.zeros(3), LEVER * np.eye(3)])
    total = 0.0
    for arm in arms:
        slopes = np.hstack([(by_turn @ arm).T, np.eye(3)])
        total += float(np.trace(slopes @ fitted.covariance[:6, :6] @ slopes.T))
    return float(np.sqrt(total / len(arms)))


def _matrix(state: Float, middle: Float) -> Float:
    rotation = np.asarray(cv2.Rodrigues(state[:3])[0], dtype=np.float64)
    return transform(rotation, state[3:6] - rotation @ middle)


def _fitted(camera: Camera, points: Float, pixels: Float, start: Float, *, focal: bool) -> _Fitted | None:
    """The fit of least reprojection error by Gauss-Newton with halved steps; None where the board ends up behind the
    camera."""
    state = start.copy()
    free = 7 if focal else 6
    error, slopes = _errors(camera, points, pixels, state)
    for _ in range(_STEPS):
        step = np.zeros(7)
        step[:free] = np.linalg.lstsq(slopes[:, :free], -error, rcond=1e-12)[0]
        for halving in range(6):
            tried = state + step / 2**halving
            if tried[5] <= 0 or tried[6] <= 0.05:
                continue
            new_error, new_slopes = _errors(camera, points, pixels, tried)
            if new_error @ new_error <= error @ error:
                break
        else:
            break
        done = error @ error - new_error @ new_error <= 1e-12 * (error @ error)
        state, error, slopes = tried, new_error, new_slopes
        if done:
            break
    if state[5] <= 0 or not np.isfinite(error).all():
        return None
    rms = float(np.sqrt(2 * np.mean(error**2)))
    covariance = np.zeros((7, 7))
    normal = slopes[:, :free].T @ slopes[:, :free]
    size = np.sqrt(np.diag(normal))
    if size.min() > 0 and np.linalg.cond(normal / np.outer(size, size)) < _UNTOLD:
        variance = max(float(error @ error) / max(len(error) - free, 1), _FLOOR_PX**2 / 2)
        covariance[:free, :free] = np.linalg.inv(normal) * variance
    else:
        covariance[:free, :free] = np.diag(np.full(free, np.inf))
    return _Fitted(state, rms, covariance)


def _errors(camera: Camera, points: Float, pixels: Float, state: Float) -> tuple[Float, Float]:
    """Projected minus measured, shape (2n,), and its derivatives by the state, shape (2n, 7)."""
    matrix = camera.matrix
    matrix[[0, 1], [0, 1]] *= state[6]
    projected, slopes = cv2.projectPoints(points, state[:3], state[3:6], matrix, np.array(camera.dist))
    by_focal = slopes[:, 6] * camera.fx + slopes[:, 7] * camera.fy
    return (projected.reshape(-1, 2) - pixels).ravel(), np.column_stack([slopes[:, :6], by_focal])
