"""Camera intrinsics from views of a board: bundle adjustment, rejection of bad views, covariance, coverage."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.camera.camera import INTRINSIC_NAMES, NUMBER_NAMES, Camera
from symcal.errors import InputError, RefusedError
from symcal.vision.board import BoardDetection, Refusal
from symcal.vision.camera_fit import (
    Wanted,
    covariance_of,
    dot_radius_of,
    fit_camera,
    matrix_of,
    residuals_of,
    unbiased,
)
from symcal.vision.corners import CornerList, is_flat, normal_of
from symcal.vision.fixed_terms import AUTO, fixed_terms, free_numbers
from symcal.vision.precision import GRID, Pose, projected, projection_sigma
from symcal.words import plural

Float = NDArray[np.float64]

OUTLIER_FACTOR = 3.0
"""A view is dropped when its rms exceeds this multiple of the median of all views used."""
UNKNOWN_FOCAL = 0.5
"""Relative standard deviation of a focal length that is no result. Ours."""
OUTLIER_PX = 0.01
"""A view whose rms is below this is never an outlier: exact points scatter by rounding. Ours."""
LEAST_VIEWS = 3
"""Of a flat board; a solid target can do with one."""


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
        board: what was seen: a board, or a list of corners.
        views: every image with a board, in the order given. refusals: every image without.
        free: names of the numbers that were estimated; the others are zero and held. asked: those held because somebody
            said so.
        sigma: standard deviations of the nine intrinsics, shape (9,), with the skew, if it was free, shape (10,); zero
            where held.
        coverage: number of points used per cell of a `GRID` over the image.
        sigma_map: error to expect of a projected point in each cell, px; see `projection_sigma`.
        dot_radius: of a circle grid, as estimated from the images, mm; None for other boards.
        shape: points of a bowed board in its frame, shape (n, 3), mm; None when it was taken as flat.
    """

    camera: Camera
    board: Board | CornerList
    views: tuple[View, ...]
    refusals: tuple[Refusal, ...]
    free: tuple[str, ...]
    asked: tuple[str, ...]
    sigma: Float
    coverage: NDArray[np.intp]
    sigma_map: Float
    dot_radius: float | None
    shape: Float | None = None

    @property
    def used(self) -> tuple[View, ...]:
        """The views that the result rests on."""
        return tuple(view for view in self.views if view.used)


def calibrate_camera(
    views: Sequence[BoardDetection] | CornerList,
    board: Board | None = None,
    refusals: Sequence[Refusal] = (),
    *,
    fix: str | Iterable[str] | None = None,
    skew: bool = False,
    keep_all: bool | None = None,
    bowed: bool = False,
) -> CameraCalibration:
    """Intrinsics, distortion and board poses that minimise the squared reprojection errors.

    Centroids of dots are freed from the bias of perspective and distortion with the dot radius that the images show.

    Args:
        views: of one camera, all of one size: a list of corners (`load_corners`), or what `detect_boards` found.
        board: as detected; a list of corners brings its own points.
        refusals: images without a board, handed through to the result; a list of corners brings its own.
        fix: terms of the lens held at zero, of k1, k2, p1, p2, k3: exactly these, all others are free. "auto": k3 where
            the data do not determine it (`K3_SIGMAS`), since it would bend the image outside the points. By default
            "auto" for detections; none for a list of corners, as OpenCV does.
        skew: estimate the skew of the image's axes too.
        keep_all: use every view. Otherwise the fit is repeated without the views whose rms exceeds `OUTLIER_FACTOR`
            times the median, until none does. By default a list of corners is used as it is, and detections are not.
        bowed: estimate the shape of the board too ([Strobl2011]); every view must show the whole board, in one order.
    Raises:
        RefusedError: too few views, or views that do not determine the camera.
        InputError: an unknown term.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> from scipy.spatial.transform import Rotation
        >>> x, y = (each.ravel() for each in np.meshgrid(30.0 * np.arange(9), 30.0 * np.arange(6)))
        >>> rows = []
        >>> for view, turn in enumerate(np.random.default_rng(1).uniform(-0.5, 0.5, (8, 3))):
        ...     seen = Rotation.from_rotvec(turn).apply(np.c_[x - 120, y - 75, 0 * x]) + [0, 0, 600]
        ...     u, v = 800 * seen[:, :2].T / seen[:, 2] + [[320], [240]]
        ...     rows.append(np.c_[np.full(54, view), np.arange(54), x, y, u, v])
        >>> head = "view,id,X_mm,Y_mm,u_px,v_px"
        >>> np.savetxt("views.csv", np.vstack(rows), "%.8g", ",", header=head, comments="")
        >>> found = sc.calibrate_camera(sc.load_corners("views.csv", size=(640, 480)))
        >>> round(found.camera.fx), round(found.camera.cx)
        (800, 320)
    """
    source: Board | CornerList
    if isinstance(views, CornerList):
        source, refusals = views, [*views.refusals, *refusals]
        views, keep_all, fix = list(views.views), keep_all is not False, () if fix is None else fix
    elif board is not None:
        source, views, fix = board, list(views), AUTO if fix is None else fix
    else:
        raise InputError("detections need the board that was detected", key="board")
    wanted = Wanted(fixed_terms(fix), skew, bowed)
    least = LEAST_VIEWS if is_flat(source.points) else 1
    needed = f"{least} or more are needed"
    _require(len(views) >= least, f"{plural(len(views), 'view')} can be used, {needed}", refusals)
    unknowns = 6 * len(views) + int(free_numbers(wanted.fixed or frozenset(), skew).sum())
    coordinates = 2 * sum(len(view.indices) for view in views)
    few = f"the views have {coordinates} coordinates of points for {unknowns} unknowns: more points are needed"
    _require(coordinates > unknowns, few, refusals)
    radius = dot_radius_of(views, source)
    used = list(range(len(views)))
    while True:
        chosen = [views[i] for i in used]
        fit, pixels = fit_camera(chosen, source, radius, wanted)
        errors = residuals_of(fit, pixels)
        rms = np.array([_rms(residuals) for residuals in errors])
        bad = outliers(rms)
        if keep_all or not bad.any():
            break
        used = [index for index, drop in zip(used, bad, strict=True) if not drop]
        message = f"after dropping views with more than {OUTLIER_FACTOR:g} times the median error {len(used)} are left"
        _require(len(used) >= least, f"{message}, {needed}", refusals)
    covariance = covariance_of(fit, np.concatenate(errors))
    names = NUMBER_NAMES if skew else INTRINSIC_NAMES
    covariance = covariance[: len(names), : len(names)]
    focal = np.sqrt(np.diag(covariance)[:2]) / fit.camera.intrinsics[:2]
    blind = f"the views do not determine the focal length (to {focal.max():.0%} only): tilt the board by 30 to 45 deg"
    _require(bool(focal.max() < UNKNOWN_FOCAL), blind, refusals)
    camera = replace(fit.camera, covariance=covariance, rms_px=_rms(np.concatenate(errors)))
    poses = dict(zip(used, fit.poses, strict=True))
    limit = f"{OUTLIER_FACTOR:g} times the median of the others ({np.median(rms):.2f} px)"
    points = fit.points[0] if bowed else source.points
    results = [_view(camera, view, points, source, poses.get(i), radius, limit) for i, view in enumerate(views)]
    return CameraCalibration(
        camera=camera,
        board=source,
        views=tuple(results),
        refusals=tuple(refusals),
        free=tuple(name for name, free in zip(names, fit.free, strict=False) if free),
        asked=tuple(name for name in names if name in (wanted.fixed or ())),
        sigma=np.sqrt(np.diag(covariance)),
        coverage=_coverage(camera, np.concatenate([view.pixels for view in results if view.used])),
        sigma_map=projection_sigma(camera),
        dot_radius=radius,
        shape=points if bowed else None,
    )


def _view(
    camera: Camera,
    view: BoardDetection,
    shape: Float,
    board: Board | CornerList,
    pose: Pose | None,
    radius: float | None,
    limit: str,
) -> View:
    points = shape[view.indices]
    used = pose is not None
    if pose is None:
        upright = view.pixels.copy()  # OpenCV has no skew
        upright[:, 0] -= camera.skew / camera.fy * (upright[:, 1] - camera.cy)
        _, turn, shift = cv2.solvePnP(points, upright, camera.matrix, np.array(camera.dist))
        pose = (np.ravel(turn).astype(float), np.ravel(shift).astype(float))
    pixels = unbiased(camera, pose, view, board, radius) if isinstance(board, Board) else view.pixels
    residuals = pixels - projected(camera, pose, points)
    transform = matrix_of(pose)
    middle = (transform @ [*points.mean(axis=0), 1.0])[:3]
    normal = transform[:3, :3] @ normal_of(board.points)
    tilt = float(np.arccos(np.clip(abs(normal @ middle) / np.linalg.norm(middle), 0, 1)))
    own = _rms(residuals)
    reason = "" if used else f"error {own:.2f} px, more than {limit}"
    return View(view.name, view.method, transform, pixels, residuals, own, tilt, view.blur_px, used, reason)


def outliers(rms: Float) -> NDArray[np.bool_]:
    """Views whose rms sticks out, shape (n,)."""
    return np.asarray(rms > max(OUTLIER_FACTOR * float(np.median(rms)), OUTLIER_PX))


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
