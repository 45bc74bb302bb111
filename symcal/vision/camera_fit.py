"""The fit of a camera to views of a board: fixed terms, then the bias of dots, then the shape of the board."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.camera.camera import NUMBER_NAMES, Camera
from symcal.errors import RefusedError
from symcal.vision.board import BoardDetection
from symcal.vision.bundle import adjust, free_coordinates
from symcal.vision.circles import dot_bias
from symcal.vision.corners import CornerList
from symcal.vision.first_guess import first_guess
from symcal.vision.fixed_terms import free_numbers
from symcal.vision.precision import Pose, intrinsic_covariance, projected

Float = NDArray[np.float64]

K3_SIGMAS = 3.0
"""k3 is free only where it differs from zero by more than this many of its standard deviations, unless somebody says
which terms are held. Ours."""


@dataclass(frozen=True, slots=True)
class CameraFit:
    """One bundle adjustment: camera, a pose and the points of each view, what was free."""

    camera: Camera
    poses: list[Pose]
    points: list[Float]
    free: NDArray[np.bool_]
    free_points: NDArray[np.bool_] | None = None


class Wanted(NamedTuple):
    """fixed: terms held at zero; None: k3 is, where the data do not determine it."""

    fixed: frozenset[str] | None
    skew: bool
    bowed: bool


def fit_camera(
    views: list[BoardDetection], board: Board | CornerList, radius: float | None, wanted: Wanted
) -> tuple[CameraFit, list[Float]]:
    """The adjustment of all stages, and the image points it rests on."""
    pixels = [view.pixels for view in views]
    fit = _adjust(views, pixels, board, free_numbers(wanted.fixed or frozenset(), wanted.skew))
    if wanted.fixed is None:
        covariance = covariance_of(fit, np.concatenate(residuals_of(fit, pixels)))
        k3 = NUMBER_NAMES.index("k3")
        if abs(fit.camera.numbers[k3]) <= K3_SIGMAS * np.sqrt(covariance[k3, k3]):
            fit = _adjust(views, pixels, board, free_numbers(frozenset({"k3"}), wanted.skew))
    if isinstance(board, Board):
        for _ in range(3 if radius is not None else 0):
            pixels = [
                unbiased(fit.camera, pose, view, board, radius) for pose, view in zip(fit.poses, views, strict=True)
            ]
            fit = _adjust(views, pixels, board, fit.free)
    return (_bend(fit, views, pixels, board) if wanted.bowed else fit), pixels


def _adjust(
    views: list[BoardDetection], pixels: list[Float], board: Board | CornerList, free: NDArray[np.bool_]
) -> CameraFit:
    """One bundle adjustment of a target as it is said to be."""
    points = [board.points[view.indices] for view in views]
    start = first_guess(points, pixels, views[0].size, free)
    camera, poses, points = adjust(*start, points, pixels, free)
    return CameraFit(camera, poses, points, free)


def _bend(fit: CameraFit, views: list[BoardDetection], pixels: list[Float], board: Board | CornerList) -> CameraFit:
    if not isinstance(board, Board):
        raise RefusedError("the shape of a board can be estimated from images of it, not from a list of corners")
    if any(len(view.indices) < len(board.points) for view in views):
        raise RefusedError("the shape of a board can be estimated only from views that show all of it")
    shape = free_coordinates(board)
    return CameraFit(*adjust(fit.camera, fit.poses, fit.points, pixels, fit.free, shape), fit.free, shape)


def residuals_of(fit: CameraFit, pixels: list[Float]) -> list[Float]:
    """Measured minus projected image points of every view, shape (n, 2), px."""
    rows = zip(fit.poses, fit.points, pixels, strict=True)
    return [measured - projected(fit.camera, pose, points) for pose, points, measured in rows]


def covariance_of(fit: CameraFit, residuals: Float) -> Float:
    """Covariance of the ten numbers, shape (10, 10); residuals of all views, shape (m, 2), px."""
    return intrinsic_covariance(
        fit.camera, fit.poses, fit.points, residuals, free=fit.free, free_points=fit.free_points
    )


def matrix_of(pose: Pose) -> Float:
    """Pose as a matrix, shape (4, 4)."""
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = cv2.Rodrigues(pose[0])[0], pose[1]
    return result


def unbiased(camera: Camera, pose: Pose, view: BoardDetection, board: Board, radius: float | None) -> Float:
    """Image points freed from the bias of centroids of dots, shape (n, 2), px."""
    if radius is None:
        return view.pixels
    bias = dot_bias(camera, board, matrix_of(pose), view.indices, radius)
    return view.pixels - np.nan_to_num(bias)


def dot_radius_of(views: list[BoardDetection], board: Board | CornerList) -> float | None:
    """Radius of the dots that the images show, mm; None for other boards."""
    radii = [view.radii for view in views if view.radii is not None]
    return float(np.median(np.concatenate(radii))) * board.square if radii and isinstance(board, Board) else None
