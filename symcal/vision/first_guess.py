"""Camera and poses from views of known points by OpenCV: where the bundle adjustment starts."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import rq

from symcal.camera.camera import NUMBER_NAMES, Camera
from symcal.errors import RefusedError
from symcal.vision.precision import Pose

Float = NDArray[np.float64]

_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-12)
_FOCALS = (0.5, 1.0, 2.0, 4.0, 8.0)  # over the image's width: tried where the points of a solid target tell none
_FIXED = {"k1": cv2.CALIB_FIX_K1, "k2": cv2.CALIB_FIX_K2, "k3": cv2.CALIB_FIX_K3}


def first_guess(
    points: Sequence[Float], pixels: Sequence[Float], size: tuple[int, int], free: NDArray[np.bool_]
) -> tuple[Camera, list[Pose]]:
    """The minimum of the squared reprojection errors, but for what OpenCV cannot express: p1 or p2 alone, and skew.

    Args:
        points: in the target's frame, one array per view, shape (n, 3), mm; flat or solid.
        pixels: their images, shape (n, 2), px.
        size: of the image, px.
        free: which of `NUMBER_NAMES` are estimated, shape (10,); the others are zero.
    Returns:
        camera, and a pose of the target for every view.
    Raises:
        RefusedError: the views do not determine the camera.
    """
    fixed = {name for name, is_free in zip(NUMBER_NAMES, free, strict=True) if not is_free}
    flags = sum(flag for name, flag in _FIXED.items() if name in fixed)
    flags |= cv2.CALIB_ZERO_TANGENT_DIST if fixed & {"p1", "p2"} else 0
    plane = _plane(np.concatenate(points))
    if plane is None:
        guesses = [_matrix(focal, size) for focal in _focals(points, pixels, size)]
        flags |= cv2.CALIB_USE_INTRINSIC_GUESS
    else:
        guesses, points = [np.eye(3)], [xyz @ plane[0].T + plane[1] for xyz in points]
    found = [answer for guess in guesses if (answer := _calibrated(points, pixels, size, guess, flags)) is not None]
    if not found:
        raise RefusedError("the views do not determine the camera: tilt the board by 30 to 45 deg in several views")
    _, camera, poses = min(found, key=lambda answer: answer[0])
    return camera, poses if plane is None else [_in_target(pose, *plane) for pose in poses]


def _calibrated(
    points: Sequence[Float], pixels: Sequence[Float], size: tuple[int, int], guess: Float, flags: int
) -> tuple[float, Camera, list[Pose]] | None:
    """OpenCV's rms, camera and poses; None where it finds none."""
    objects = [xyz.astype(np.float32) for xyz in points]
    images = [image.astype(np.float32).reshape(-1, 1, 2) for image in pixels]
    try:
        rms, matrix, dist, turns, shifts = cv2.calibrateCamera(
            objects, images, size, guess.copy(), np.zeros(5), flags=flags, criteria=_CRITERIA
        )
    except cv2.error:
        return None
    numbers = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *np.ravel(dist)[:5]])
    if not np.all(np.isfinite(numbers)) or min(numbers[:2]) <= 0:
        return None
    fx, fy, cx, cy, *coefficients = numbers.tolist()
    poses = [(np.ravel(r).astype(float), np.ravel(t).astype(float)) for r, t in zip(turns, shifts, strict=True)]
    return float(rms), Camera(*size, fx, fy, cx, cy, tuple(coefficients)), poses


def _plane(points: Float) -> tuple[Float, Float] | None:
    """R, t with R p + t in the plane z = 0 for all points of a flat target; None for a solid one.

    OpenCV knows a flat target by its z, which must be zero.
    """
    if not np.any(points[:, 2]):
        return np.eye(3), np.zeros(3)
    middle = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=False)
    if spread[2] > 1e-7 * spread[0]:
        return None
    turn = axes * np.linalg.det(axes)
    return turn, -turn @ middle


def _in_target(pose: Pose, turn: Float, shift: Float) -> Pose:
    """Pose of the target's frame from that of its plane."""
    rotation, _ = cv2.Rodrigues(pose[0])
    vector, _ = cv2.Rodrigues(rotation @ turn)
    return np.ravel(vector).astype(float), rotation @ shift + pose[1]


def _matrix(focal: float, size: tuple[int, int]) -> Float:
    return np.array([[focal, 0.0, (size[0] - 1) / 2], [0.0, focal, (size[1] - 1) / 2], [0.0, 0.0, 1.0]])


def _focals(points: Sequence[Float], pixels: Sequence[Float], size: tuple[int, int]) -> list[float]:
    """Focal lengths to start from: the median of those that single views tell, and a ladder."""
    each = [_focal(xyz, image) for xyz, image in zip(points, pixels, strict=True)]
    told = [focal for focal in each if 0.1 * size[0] < focal < 100 * size[0]]
    return [*([float(np.median(told))] if told else []), *(share * size[0] for share in _FOCALS)]


def _focal(points: Float, pixels: Float) -> float:
    """Focal length of a projection matrix that maps the points to the pixels; NaN where they tell none.

    Direct linear transform of [AbdelAziz1971], points and pixels shifted and scaled to unit size.
    """
    if len(points) < 6:
        return float("nan")
    xyz, uv = (places - places.mean(axis=0) for places in (points, pixels))
    scale, width = np.abs(xyz).max(), np.abs(uv).max()
    one = np.column_stack([xyz / scale, np.ones(len(xyz))])
    zero = np.zeros_like(one)
    u, v = (uv / width).T[:, :, None]
    equations = np.block([[one, zero, -u * one], [zero, one, -v * one]])
    _, spread, rows = np.linalg.svd(equations)
    if spread[-2] < 1e-6 * spread[0]:
        return float("nan")
    upper = np.asarray(rq(rows[-1].reshape(3, 4)[:, :3])[0])
    last = abs(upper[2, 2])
    return float(width * np.sqrt(abs(upper[0, 0] * upper[1, 1])) / last) if last > 0 else float("nan")
