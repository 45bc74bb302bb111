"""Camera intrinsics from views of a board: bundle adjustment, rejection of bad views, covariance, coverage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera import INTRINSIC_NAMES, Board, Camera, rays
from symcal.errors import RefusedError
from symcal.vision.board import Detection, Refusal
from symcal.vision.circles import dot_bias

Float = NDArray[np.float64]

OUTLIER_FACTOR = 3.0
"""A view is dropped when its rms exceeds this multiple of the median of all views used."""
K3_SIGMAS = 3.0
"""k3 is free only where it differs from zero by more than this many of its standard deviations. Ours."""
LEAST_VIEWS = 3
GRID = (6, 8)
"""Rows and columns of the coverage map."""

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

    @property
    def used(self) -> tuple[View, ...]:
        """The views that the result rests on."""
        return tuple(view for view in self.views if view.used)


@dataclass(frozen=True, slots=True)
class _Fit:
    camera: Camera
    poses: list[tuple[Float, Float]]


def calibrate_camera(
    detections: Sequence[Detection], board: Board, refusals: Sequence[Refusal] = ()
) -> CameraCalibration:
    """Intrinsics, distortion and board poses that minimise the squared reprojection errors.

    Repeated without the views whose rms exceeds `OUTLIER_FACTOR` times the median, until none does. k3 is estimated
    where the data determine it (`K3_SIGMAS`), else held at zero: an undetermined k3 bends the image outside the points.
    Centroids of dots are freed from the bias of perspective and distortion with the dot radius that the images show.

    Args:
        detections: views of one camera, all of one size.
        board: as detected.
        refusals: images without a board, handed through to the result.
    Raises:
        RefusedError: fewer than three views, or views that do not determine the camera.
    """
    views = list(detections)
    _require(
        len(views) >= LEAST_VIEWS, f"{len(views)} views show the board, at least {LEAST_VIEWS} are needed", refusals
    )
    radius = _dot_radius(views, board)
    used = list(range(len(views)))
    while True:
        fit, free_k3 = _fit(views, used, board, radius)
        rms = np.array([_rms(residuals) for residuals in _residuals(fit, views, used, board, radius)])
        bad = rms > OUTLIER_FACTOR * np.median(rms)
        if not bad.any():
            break
        used = [index for index, drop in zip(used, bad, strict=True) if not drop]
        message = f"after dropping views with more than {OUTLIER_FACTOR:g} times the median error {len(used)} are left"
        _require(len(used) >= LEAST_VIEWS, f"{message}, at least {LEAST_VIEWS} are needed", refusals)
    residuals = np.concatenate(_residuals(fit, views, used, board, radius))
    covariance = _covariance(fit, [views[i] for i in used], board, residuals, free_k3)
    camera = replace(fit.camera, covariance=covariance, rms_px=_rms(residuals))
    poses = dict(zip(used, fit.poses, strict=True))
    results = [_view(camera, view, board, poses.get(index), radius, rms) for index, view in enumerate(views)]
    return CameraCalibration(
        camera=camera,
        board=board,
        views=tuple(results),
        refusals=tuple(refusals),
        free=INTRINSIC_NAMES if free_k3 else INTRINSIC_NAMES[:-1],
        sigma=np.sqrt(np.diag(covariance)),
        coverage=_coverage(camera, np.concatenate([view.pixels for view in results if view.used])),
        sigma_map=projection_sigma(camera),
        dot_radius=radius,
    )


def projection_sigma(camera: Camera, grid: tuple[int, int] = GRID) -> Float:
    """Error to expect of the projection of a far point in each cell of the image, px, shape `grid`.

    sqrt(tr(J C J^T)) with the covariance C of the intrinsics; the rotation of the camera that hides most of it is taken
    out first, because whoever uses the camera estimates its rotation anyway. NaN where the lens shows nothing.

    Args:
        camera: with its covariance.
        grid: rows and columns.
    Source: the idea of projection uncertainty in mrcal; compensation by a rotation over the whole image is ours.
    """
    v, u = np.meshgrid(
        *((np.arange(n) + 0.5) * size / n - 0.5 for n, size in zip(grid, _shape(camera), strict=True)), indexing="ij"
    )
    ray = rays(camera, np.stack([u, v], axis=-1)).reshape(-1, 2)
    seen = np.isfinite(ray[:, 0])
    sigma = np.full(seen.shape, np.nan)
    points = np.column_stack([ray[seen], np.ones(seen.sum())])
    jacobian = _jacobian(camera, (np.zeros(3), np.zeros(3)), points)
    turn, _ = np.linalg.qr(jacobian[:, :3])
    rest = jacobian[:, 6:] - turn @ (turn.T @ jacobian[:, 6:])
    covariance = np.zeros((9, 9)) if camera.covariance is None else camera.covariance
    sigma[seen] = np.sqrt(np.einsum("ij,jk,ik->i", rest, covariance, rest).reshape(-1, 2).sum(axis=1))
    return sigma.reshape(grid)


def _fit(views: list[Detection], used: list[int], board: Board, radius: float | None) -> tuple[_Fit, bool]:
    chosen = [views[i] for i in used]
    fit = _adjust(chosen, [view.pixels for view in chosen], board, free_k3=True)
    residuals = np.concatenate(_residuals(fit, views, used, board, None))
    sigma = np.sqrt(_covariance(fit, chosen, board, residuals, True)[8, 8])
    free_k3 = bool(abs(fit.camera.dist[4]) > K3_SIGMAS * sigma)
    if not free_k3:
        fit = _adjust(chosen, [view.pixels for view in chosen], board, free_k3=False)
    for _ in range(3 if radius is not None else 0):
        pixels = [
            _unbiased(fit.camera, pose, view, board, radius) for pose, view in zip(fit.poses, chosen, strict=True)
        ]
        fit = _adjust(chosen, pixels, board, free_k3)
    return fit, free_k3


def _adjust(views: list[Detection], pixels: list[Float], board: Board, free_k3: bool) -> _Fit:
    """One bundle adjustment by OpenCV."""
    points = [board.points[view.indices].astype(np.float32) for view in views]
    images = [image.astype(np.float32).reshape(-1, 1, 2) for image in pixels]
    flags = 0 if free_k3 else cv2.CALIB_FIX_K3
    size = views[0].size
    try:
        _, matrix, dist, turns, shifts = cv2.calibrateCamera(
            points, images, size, np.eye(3), np.zeros(5), flags=flags, criteria=_CRITERIA
        )
    except cv2.error as error:
        raise RefusedError(f"the views do not determine the camera: {str(error).strip()}") from None
    numbers = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *np.ravel(dist)[:5]])
    if not np.all(np.isfinite(numbers)) or min(numbers[:2]) <= 0:
        raise RefusedError("the views do not determine the camera: tilt the board by 30 to 45 deg in several views")
    fx, fy, cx, cy, *dist_coefficients = numbers.tolist()
    camera = Camera(size[0], size[1], fx, fy, cx, cy, tuple(dist_coefficients))
    return _Fit(
        camera, [(np.ravel(r).astype(float), np.ravel(t).astype(float)) for r, t in zip(turns, shifts, strict=True)]
    )


def _residuals(fit: _Fit, views: list[Detection], used: list[int], board: Board, radius: float | None) -> list[Float]:
    result = []
    for index, pose in zip(used, fit.poses, strict=True):
        pixels = _unbiased(fit.camera, pose, views[index], board, radius)
        result.append(pixels - _projected(fit.camera, pose, board.points[views[index].indices]))
    return result


def _projected(camera: Camera, pose: tuple[Float, Float], points: Float) -> Float:
    pixels, _ = cv2.projectPoints(points, *pose, camera.matrix, np.array(camera.dist))
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def _jacobian(camera: Camera, pose: tuple[Float, Float], points: Float) -> Float:
    """Derivative of the image points, u and v in turn, by rotation vector, translation and the nine intrinsics."""
    _, jacobian = cv2.projectPoints(points, *pose, camera.matrix, np.array(camera.dist))
    return np.asarray(jacobian, dtype=np.float64)


def _covariance(fit: _Fit, views: list[Detection], board: Board, residuals: Float, free_k3: bool) -> Float:
    """Covariance of the nine intrinsics, the poses marginalised; zero rows where held.

    Each view's Jacobian by the intrinsics is projected off that by its pose; a QR of the stack gives
    sigma^2 (R^T R)^-1, sigma^2 being the squared residuals over the degrees of freedom (coordinates minus unknowns).
    """
    free = 9 if free_k3 else 8
    rows = []
    for pose, view in zip(fit.poses, views, strict=True):
        jacobian = _jacobian(fit.camera, pose, board.points[view.indices])
        basis, _ = np.linalg.qr(jacobian[:, :6])
        rows.append(jacobian[:, 6 : 6 + free] - basis @ (basis.T @ jacobian[:, 6 : 6 + free]))
    stack = np.concatenate(rows)
    scale = np.linalg.norm(stack, axis=0)
    triangle = np.linalg.qr(stack / scale, mode="r")
    if np.linalg.cond(triangle) > 1e10:
        raise RefusedError("the views do not determine the camera: tilt the board by 30 to 45 deg in several views")
    freedom = residuals.size - free - 6 * len(views)
    if freedom <= 0:
        raise RefusedError("the views have too few points to determine the camera")
    inverse = np.linalg.inv(triangle) / scale[:, None]
    covariance = np.zeros((9, 9))
    covariance[:free, :free] = inverse @ inverse.T * (np.sum(residuals**2) / freedom)
    return covariance


def _view(
    camera: Camera, view: Detection, board: Board, pose: tuple[Float, Float] | None, radius: float | None, rms: Float
) -> View:
    used = pose is not None
    if pose is None:
        _, turn, shift = cv2.solvePnP(board.points[view.indices], view.pixels, camera.matrix, np.array(camera.dist))
        pose = (np.ravel(turn).astype(float), np.ravel(shift).astype(float))
    pixels = _unbiased(camera, pose, view, board, radius)
    residuals = pixels - _projected(camera, pose, board.points[view.indices])
    transform = _transform(pose)
    middle = (transform @ [*board.points[view.indices].mean(axis=0), 1.0])[:3]
    tilt = float(np.arccos(np.clip(abs(transform[:3, 2] @ middle) / np.linalg.norm(middle), 0, 1)))
    own = _rms(residuals)
    limit = f"{OUTLIER_FACTOR:g} times the median of the others ({np.median(rms):.2f} px)"
    reason = "" if used else f"error {own:.2f} px, more than {limit}"
    return View(view.name, view.method, transform, pixels, residuals, own, tilt, view.blur_px, used, reason)


def _transform(pose: tuple[Float, Float]) -> Float:
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = cv2.Rodrigues(pose[0])[0], pose[1]
    return result


def _unbiased(camera: Camera, pose: tuple[Float, Float], view: Detection, board: Board, radius: float | None) -> Float:
    if radius is None:
        return view.pixels
    bias = dot_bias(camera, board, _transform(pose), view.indices, radius)
    return view.pixels - np.nan_to_num(bias)


def _dot_radius(views: list[Detection], board: Board) -> float | None:
    radii = [view.radii for view in views if view.radii is not None]
    return float(np.median(np.concatenate(radii))) * board.square if radii else None


def _coverage(camera: Camera, pixels: Float) -> NDArray[np.intp]:
    height, width = _shape(camera)
    edges = [np.linspace(-0.5, height - 0.5, GRID[0] + 1), np.linspace(-0.5, width - 0.5, GRID[1] + 1)]
    return np.histogram2d(pixels[:, 1], pixels[:, 0], bins=edges)[0].astype(np.intp)


def _shape(camera: Camera) -> tuple[int, int]:
    return camera.height, camera.width


def _rms(residuals: Float) -> float:
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=-1))))


def _require(condition: bool, message: str, refusals: Sequence[Refusal]) -> None:
    if not condition:
        tail = "; ".join(f"{refusal.name}: {refusal.reason}" for refusal in refusals)
        raise RefusedError(f"{message}{'; ' if tail else ''}{tail}")
