"""Where a board stands in the camera that sees it, and what its image says of the focal length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.camera.camera import Camera
from symcal.camera.planar_pose import planar_poses
from symcal.camera.reproject import moved, reproject, skew

Float = NDArray[np.float64]

LEVER = 200.0
"""mm: a board's pose is judged at its middle and at this distance from it along each axis."""

_ALIKE = 2.0  # a second pose whose rms is at most this multiple of the first one's cannot be told from it
_SAME = 1e-3  # mm and rad: two poses this near each other are one
_FLOOR_PX = 0.05  # rms below which nothing is concluded from its ratio
_STEPS = 20
_SETTLED = 1e-12
_UNTOLD = 1e12  # condition number of the scaled normal equations from which nothing is told


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


@dataclass(frozen=True, slots=True)
class _Fitted:
    """T_camera_board and focal ratio; rms, px; covariance of the pose's increment and the ratio, shape (7, 7), at the
    scatter of the residuals, infinite where they say nothing."""

    pose: Float
    focal: float
    rms: float
    covariance: Float


def board_pose(camera: Camera, board: Board, indices: NDArray[np.intp], pixels: Float) -> BoardPose | None:
    """The poses of a board from some of its points in one image; None where they give none.

    Args:
        indices: which of `Board.points`, shape (n,). pixels: where, shape (n, 2), px.
    """
    points = board.points[indices]
    starts, errors = planar_poses(camera, points, pixels[None], np.array(board.normal))
    found = [
        fitted
        for start, error in zip(starts[0], errors[0], strict=True)
        if np.isfinite(error) and (fitted := _fitted(camera, points, pixels, start, focal=False)) is not None
    ]
    if not found:
        return None
    found.sort(key=lambda each: each.rms)
    best = found[0]
    kept = [each.pose for each in found if each.rms <= _ALIKE * max(best.rms, _FLOOR_PX)]
    if len(kept) == 2 and np.abs(kept[0] - kept[1]).max() < _SAME:
        kept.pop()
    sigma = _scatter(best, board.points.mean(axis=0))
    free = _fitted(camera, points, pixels, best.pose, focal=True)
    if free is None:
        return BoardPose(np.array(kept), best.rms, sigma, 1.0, np.inf, best.rms)
    focal_sigma = float(np.sqrt(free.covariance[6, 6]))
    return BoardPose(np.array(kept), best.rms, sigma, free.focal, focal_sigma, free.rms)


def _scatter(fitted: _Fitted, middle: Float) -> float:
    """Standard deviation of the middle and of three points around it, rms, mm."""
    arms = middle + np.vstack([np.zeros(3), LEVER * np.eye(3)])
    slopes = np.concatenate([np.broadcast_to(np.eye(3), (4, 3, 3)), -fitted.pose[:3, :3] @ skew(arms)], axis=2)
    variance = np.einsum("nij,jk,nik->n", slopes, fitted.covariance[:6, :6], slopes)
    return float(np.sqrt(variance.mean()))


def _fitted(camera: Camera, points: Float, pixels: Float, pose: Float, *, focal: bool) -> _Fitted | None:
    """The fit of least reprojection error by Gauss-Newton with halved steps; None where the board ends up behind the
    camera."""
    free, ratio = (7, 1.0) if focal else (6, 1.0)
    error, slopes = _errors(camera, points, pixels, pose, ratio)
    for _ in range(_STEPS):
        step = np.zeros(7)
        step[:free] = np.linalg.lstsq(slopes[:, :free], -error, rcond=1e-12)[0]
        for halving in range(6):
            tried, tried_ratio = moved(pose, step[:6] / 2**halving), ratio + step[6] / 2**halving
            if (points @ tried[2, :3] + tried[2, 3]).min() <= 0 or tried_ratio <= 0.05:
                continue
            new_error, new_slopes = _errors(camera, points, pixels, tried, tried_ratio)
            if new_error @ new_error <= error @ error:
                break
        else:
            break
        settled = error @ error - new_error @ new_error <= _SETTLED * (error @ error)
        pose, ratio, error, slopes = tried, tried_ratio, new_error, new_slopes
        if settled:
            break
    if not np.isfinite(error).all():
        return None
    return _Fitted(pose, float(ratio), float(np.sqrt(2 * np.mean(error**2))), _covariance(slopes[:, :free], error))


def _covariance(slopes: Float, error: Float) -> Float:
    """Shape (7, 7); zero where something was held."""
    free = slopes.shape[1]
    covariance = np.zeros((7, 7))
    normal = slopes.T @ slopes
    size = np.sqrt(np.diag(normal))
    if size.min() > 0 and np.linalg.cond(normal / np.outer(size, size)) < _UNTOLD:
        variance = max(float(error @ error) / max(len(error) - free, 1), _FLOOR_PX**2 / 2)
        covariance[:free, :free] = np.linalg.inv(normal / np.outer(size, size)) / np.outer(size, size) * variance
    else:
        np.fill_diagonal(covariance[:free, :free], np.inf)
    return covariance


def _errors(camera: Camera, points: Float, pixels: Float, pose: Float, ratio: float) -> tuple[Float, Float]:
    """Projected minus measured, shape (2n,), and its derivatives by pose increment and focal ratio, shape (2n, 7)."""
    projected, slopes = reproject(camera, pose, points)
    from_centre = projected - [camera.cx, camera.cy]
    error = from_centre * ratio + [camera.cx, camera.cy] - pixels
    return error.ravel(), np.column_stack([slopes.reshape(-1, 6) * ratio, from_centre.ravel()])
