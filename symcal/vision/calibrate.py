"""Camera intrinsics from views of a board: bundle adjustment, rejection of bad views, covariance, coverage."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.camera.camera import INTRINSIC_NAMES, Camera
from symcal.errors import RefusedError
from symcal.vision.board import BoardDetection, Refusal
from symcal.vision.bowed import adjust_bowed, free_coordinates
from symcal.vision.circles import dot_bias
from symcal.vision.precision import GRID, Pose, intrinsic_covariance, projected, projection_sigma

Float = NDArray[np.float64]

OUTLIER_FACTOR = 3.0
"""A view is dropped when its rms exceeds this multiple of the median of all views used."""
K3_SIGMAS = 3.0
"""k3 is free only where it differs from zero by more than this many of its standard deviations. Ours."""
LEAST_VIEWS = 3

_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-12)


@dataclass(frozen=True, slots=True)
class View:
    """One image in the calibration.

    Attributes:
        name: the image's. method: the detector.
        T_camera_board: shape (4, 4), mm.
        pixels: measured points, shape (n, 2), px (of a circle grid: freed from the bias of the centroids).
        residuals: measured minus projected, shape (n, 2), px.
        rms_px: of the points' residual lengths.
        tilt: angle between the board's normal and the line of sight to its middle, rad.
        blur_px: sigma of the edges, px.
        used: whether the result rests on it. reason: why not, empty otherwise.
    """

    name: str
    method: str
    T_camera_board: Float
    pixels: Float
    residuals: Float
    rms_px: float
    tilt: float
    blur_px: float
    used: bool
    reason: str


@dataclass(frozen=True, slots=True)
class CameraCalibration:
    """A camera and how well it is known.

    Attributes:
        camera: with covariance and rms of the views used.
        board: what was seen.
        views: every image with a board, in the order given. refusals: every image without.
        free: names of the intrinsics that were estimated; the others are zero and held.
        sigma: standard deviations of the nine intrinsics, shape (9,); zero where held.
        coverage: number of points used per cell of a `GRID` over the image.
        sigma_map: error to expect of a projected point in each cell, px; see `projection_sigma`.
        dot_radius: of a circle grid, as estimated from the images, mm; None for other boards.
        shape: points of a bowed board in its frame, shape (n, 3), mm; None when it was taken as flat.
    """

    camera: Camera
    board: Board
    views: tuple[View, ...]
    refusals: tuple[Refusal, ...]
    free: tuple[str, ...]
    sigma: Float
    coverage: NDArray[np.intp]
    sigma_map: Float
    dot_radius: float | None
    shape: Float | None = None

    @property
    def used(self) -> tuple[View, ...]:
        """The views that the result rests on."""
        return tuple(view for view in self.views if view.used)


@dataclass(frozen=True, slots=True)
class _Fit:
    """One bundle adjustment: camera, a pose for each view, the board's points and what was free."""

    camera: Camera
    poses: list[Pose]
    points: Float
    free_k3: bool
    free_points: NDArray[np.bool_] | None = None


def calibrate_camera(
    detections: Sequence[BoardDetection], board: Board, refusals: Sequence[Refusal] = (), *, bowed: bool = False
) -> CameraCalibration:
    """Intrinsics, distortion and board poses that minimise the squared reprojection errors.

    Repeated without the views whose rms exceeds `OUTLIER_FACTOR` times the median, until none does. k3 is estimated
    where the data determine it (`K3_SIGMAS`), else held at zero: an undetermined k3 bends the image outside the points.
    Centroids of dots are freed from the bias of perspective and distortion with the dot radius that the images show.

    Args:
        detections: views of one camera, all of one size.
        board: as detected.
        refusals: images without a board, handed through to the result.
        bowed: estimate the shape of the board too ([Strobl2011]); every view must show the whole board, in one order.
    Raises:
        RefusedError: fewer than three views, or views that do not determine the camera.
    """
    views = list(detections)
    _require(
        len(views) >= LEAST_VIEWS, f"{len(views)} views show the board, {LEAST_VIEWS} or more are needed", refusals
    )
    radius = _dot_radius(views, board)
    used = list(range(len(views)))
    while True:
        chosen = [views[i] for i in used]
        fit, pixels = _fit(chosen, board, radius, bowed)
        errors = _residuals(fit, chosen, pixels)
        rms = np.array([_rms(residuals) for residuals in errors])
        bad = rms > OUTLIER_FACTOR * np.median(rms)
        if not bad.any():
            break
        used = [index for index, drop in zip(used, bad, strict=True) if not drop]
        message = f"after dropping views with more than {OUTLIER_FACTOR:g} times the median error {len(used)} are left"
        _require(len(used) >= LEAST_VIEWS, f"{message}, {LEAST_VIEWS} or more are needed", refusals)
    covariance = _covariance(fit, chosen, np.concatenate(errors))
    camera = replace(fit.camera, covariance=covariance, rms_px=_rms(np.concatenate(errors)))
    fit = replace(fit, camera=camera)
    poses = dict(zip(used, fit.poses, strict=True))
    limit = f"{OUTLIER_FACTOR:g} times the median of the others ({np.median(rms):.2f} px)"
    results = [_view(fit, view, board, poses.get(index), radius, limit) for index, view in enumerate(views)]
    return CameraCalibration(
        camera=camera,
        board=board,
        views=tuple(results),
        refusals=tuple(refusals),
        free=INTRINSIC_NAMES if fit.free_k3 else INTRINSIC_NAMES[:-1],
        sigma=np.sqrt(np.diag(covariance)),
        coverage=_coverage(camera, np.concatenate([view.pixels for view in results if view.used])),
        sigma_map=projection_sigma(camera),
        dot_radius=radius,
        shape=fit.points if bowed else None,
    )


def _fit(views: list[BoardDetection], board: Board, radius: float | None, bowed: bool) -> tuple[_Fit, list[Float]]:
    """The adjustment of all stages, and the image points it rests on."""
    pixels = [view.pixels for view in views]
    fit = _adjust(views, pixels, board, free_k3=True)
    covariance = _covariance(fit, views, np.concatenate(_residuals(fit, views, pixels)))
    free_k3 = bool(abs(fit.camera.dist[4]) > K3_SIGMAS * np.sqrt(covariance[8, 8]))
    if not free_k3:
        fit = _adjust(views, pixels, board, free_k3=False)
    for _ in range(3 if radius is not None else 0):
        pixels = [_unbiased(fit.camera, pose, view, board, radius) for pose, view in zip(fit.poses, views, strict=True)]
        fit = _adjust(views, pixels, board, free_k3)
    return (_bend(fit, views, pixels, board) if bowed else fit), pixels


def _adjust(views: list[BoardDetection], pixels: list[Float], board: Board, free_k3: bool) -> _Fit:
    """One bundle adjustment by OpenCV with a flat board."""
    points = [board.points[view.indices].astype(np.float32) for view in views]
    images = [image.astype(np.float32).reshape(-1, 1, 2) for image in pixels]
    flags = 0 if free_k3 else cv2.CALIB_FIX_K3
    start = (views[0].size, np.eye(3), np.zeros(5))
    try:
        _, matrix, dist, turns, shifts = cv2.calibrateCamera(points, images, *start, flags=flags, criteria=_CRITERIA)
    except cv2.error as error:
        raise RefusedError(f"the views do not determine the camera: {str(error).strip()}") from None
    return _Fit(_checked(views[0].size, matrix, dist), _poses(turns, shifts), board.points, free_k3)


def _bend(fit: _Fit, views: list[BoardDetection], pixels: list[Float], board: Board) -> _Fit:
    if any(len(view.indices) < len(board.points) for view in views):
        raise RefusedError("the shape of a board can be estimated only from views that show all of it")
    camera, poses, points = adjust_bowed(fit.camera, fit.poses, board, pixels, fit.free_k3)
    return _Fit(camera, poses, points, fit.free_k3, free_coordinates(board))


def _checked(size: tuple[int, int], matrix: object, dist: object) -> Camera:
    k = np.asarray(matrix, dtype=np.float64)
    numbers = np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], *np.ravel(np.asarray(dist))[:5]])
    if not np.all(np.isfinite(numbers)) or min(numbers[:2]) <= 0:
        raise RefusedError("the views do not determine the camera: tilt the board by 30 to 45 deg in several views")
    fx, fy, cx, cy, *coefficients = numbers.tolist()
    return Camera(size[0], size[1], fx, fy, cx, cy, tuple(coefficients))


def _poses(turns: Iterable[object], shifts: Iterable[object]) -> list[Pose]:
    return [(np.ravel(r).astype(float), np.ravel(t).astype(float)) for r, t in zip(turns, shifts, strict=True)]  # type: ignore[call-overload]


def _residuals(fit: _Fit, views: list[BoardDetection], pixels: list[Float]) -> list[Float]:
    return [
        measured - projected(fit.camera, pose, fit.points[view.indices])
        for pose, view, measured in zip(fit.poses, views, pixels, strict=True)
    ]


def _covariance(fit: _Fit, views: list[BoardDetection], residuals: Float) -> Float:
    points = [fit.points[view.indices] for view in views]
    return intrinsic_covariance(
        fit.camera, fit.poses, points, residuals, free_k3=fit.free_k3, free_points=fit.free_points
    )


def _view(fit: _Fit, view: BoardDetection, board: Board, pose: Pose | None, radius: float | None, limit: str) -> View:
    camera, points = fit.camera, fit.points[view.indices]
    used = pose is not None
    if pose is None:
        _, turn, shift = cv2.solvePnP(points, view.pixels, camera.matrix, np.array(camera.dist))
        pose = (np.ravel(turn).astype(float), np.ravel(shift).astype(float))
    pixels = _unbiased(camera, pose, view, board, radius)
    residuals = pixels - projected(camera, pose, points)
    transform = _transform(pose)
    middle = (transform @ [*points.mean(axis=0), 1.0])[:3]
    tilt = float(np.arccos(np.clip(abs(transform[:3, 2] @ middle) / np.linalg.norm(middle), 0, 1)))
    own = _rms(residuals)
    reason = "" if used else f"error {own:.2f} px, more than {limit}"
    return View(view.name, view.method, transform, pixels, residuals, own, tilt, view.blur_px, used, reason)


def _transform(pose: Pose) -> Float:
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = cv2.Rodrigues(pose[0])[0], pose[1]
    return result


def _unbiased(camera: Camera, pose: Pose, view: BoardDetection, board: Board, radius: float | None) -> Float:
    if radius is None:
        return view.pixels
    bias = dot_bias(camera, board, _transform(pose), view.indices, radius)
    return view.pixels - np.nan_to_num(bias)


def _dot_radius(views: list[BoardDetection], board: Board) -> float | None:
    radii = [view.radii for view in views if view.radii is not None]
    return float(np.median(np.concatenate(radii))) * board.square if radii else None


def _coverage(camera: Camera, pixels: Float) -> NDArray[np.intp]:
    edges = [
        np.linspace(-0.5, size - 0.5, cells + 1)
        for size, cells in zip((camera.height, camera.width), GRID, strict=True)
    ]
    return np.histogram2d(pixels[:, 1], pixels[:, 0], bins=edges)[0].astype(np.intp)


def _rms(residuals: Float) -> float:
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=-1))))


def _require(condition: bool, message: str, refusals: Sequence[Refusal]) -> None:
    if not condition:
        tail = "; ".join(f"{refusal.name}: {refusal.reason}" for refusal in refusals)
        raise RefusedError(f"{message}{'; ' if tail else ''}{tail}")
