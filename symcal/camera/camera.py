"""Pinhole camera with lens distortion.

Conventions are OpenCV's: x right, y down, z along the view; integer pixel coordinates are pixel centres, so that
the image covers [-0.5, width - 0.5] x [-0.5, height - 0.5]. OpenCV itself is not needed here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError

INTRINSIC_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
NUMBER_NAMES = (*INTRINSIC_NAMES, "skew")
"""With the skew, which is zero unless somebody asks for it."""

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Camera:
    """Intrinsics of one camera, in pixels.

    Attributes:
        width, height: image size, px.
        fx, fy, cx, cy: focal lengths and principal point, px.
        dist: (k1, k2, p1, p2, k3); fewer are filled up with zeros.
        covariance: of the nine `INTRINSIC_NAMES`, shape (9, 9), or of the ten `NUMBER_NAMES`, shape (10, 10); zero rows
            where a number was held; None if unknown.
        rms_px: reprojection error of the calibration (root mean square of the point distances), None when unknown.
        skew: of the image's axes, px: what y adds to u. OpenCV's model does not have it.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    dist: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    covariance: Float | None = field(default=None, compare=False)
    rms_px: float | None = None
    skew: float = 0.0

    def __post_init__(self) -> None:
        if len(self.dist) > 5:
            raise InputError(
                "at most five distortion coefficients (k1, k2, p1, p2, k3)", key="distortion", found=len(self.dist)
            )
        object.__setattr__(self, "dist", (*(float(k) for k in self.dist), *(0.0,) * (5 - len(self.dist))))
        for name in ("width", "height", "fx", "fy"):
            if not getattr(self, name) > 0:
                raise InputError("must be positive", key=name, found=getattr(self, name))
        if self.covariance is not None and np.shape(self.covariance) not in ((9, 9), (10, 10)):
            message = "must be a 9 x 9 matrix (10 x 10 with the skew)"
            raise InputError(message, key="covariance", found=np.shape(self.covariance))

    @property
    def matrix(self) -> Float:
        """Camera matrix K, shape (3, 3), px."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def intrinsics(self) -> Float:
        """The nine numbers in the order of `INTRINSIC_NAMES`, shape (9,)."""
        return np.array([self.fx, self.fy, self.cx, self.cy, *self.dist])

    @property
    def numbers(self) -> Float:
        """The ten numbers in the order of `NUMBER_NAMES`, shape (10,)."""
        return np.array([*self.intrinsics, self.skew])

    @property
    def has_skew(self) -> bool:
        """Whether the skew is more than zero and held: it has a value, or a place in the covariance."""
        return self.skew != 0 or (self.covariance is not None and len(self.covariance) == len(NUMBER_NAMES))

    def with_numbers(self, numbers: Float) -> Camera:
        """The camera with other numbers in the order of `NUMBER_NAMES`, shape (10,)."""
        fx, fy, cx, cy, *dist, skew = np.asarray(numbers, dtype=np.float64).tolist()
        return replace(self, fx=fx, fy=fy, cx=cx, cy=cy, dist=tuple(dist), skew=skew)


def distort(x: Any, y: Any, dist: Any) -> tuple[Any, Any]:
    r"""Distorted normalised coordinates.

    x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), y_d likewise with p1 and p2 swapped.

    Args:
        x: X / Z; SX, float or array.
        y: Y / Z, of the same kind.
        dist: k1, k2, p1, p2, k3.
    Source: [Brown1966] in the form and order of OpenCV.
    """
    k1, k2, p1, p2, k3 = (dist[i] for i in range(5))
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def project(point_camera: ca.SX, intrinsics: ca.SX) -> ca.SX:
    """Image point of a point in the camera frame, symbolic.

    (u, v) = (fx x_d + skew y_d + cx, fy y_d + cy), with (x_d, y_d) of `distort`.

    Args:
        point_camera: shape (3,), any length unit, Z > 0.
        intrinsics: shape (9,), order of `INTRINSIC_NAMES`, or (10,), of `NUMBER_NAMES`.
    Returns:
        (u, v), shape (2,), px.
    """
    x, y = point_camera[0] / point_camera[2], point_camera[1] / point_camera[2]
    xd, yd = distort(x, y, intrinsics[4:9])
    u = intrinsics[0] * xd + intrinsics[2]
    if intrinsics.numel() > len(INTRINSIC_NAMES):
        u += intrinsics[9] * yd
    pixel: ca.SX = ca.vertcat(u, intrinsics[1] * yd + intrinsics[3])
    return pixel


def project_points(camera: Camera, points_camera: Float) -> Float:
    """Image points of many points in the camera frame, numeric.

    Args:
        camera: numbers and distortion.
        points_camera: shape (..., 3), mm.
    Returns:
        shape (..., 2), px; NaN where Z <= 0 or beyond the radius at which the distortion folds back (`fold_radius`).
    """
    points = np.asarray(points_camera, dtype=np.float64)
    front = points[..., 2] > 0
    z = np.where(front, points[..., 2], 1.0)
    x, y = points[..., 0] / z, points[..., 1] / z
    xd, yd = distort(x, y, camera.dist)
    seen = front & (np.hypot(x, y) < fold_radius(camera))
    pixels = np.stack([camera.fx * xd + camera.skew * yd + camera.cx, camera.fy * yd + camera.cy], axis=-1)
    return cast(Float, np.where(seen[..., None], pixels, np.nan))


def in_image(camera: Camera, pixels: Float, margin: float = 0.0) -> NDArray[np.bool_]:
    """Whether image points, shape (..., 2), lie at least `margin` px inside the image's border (NaN: no)."""
    u, v = pixels[..., 0], pixels[..., 1]
    low = margin - 0.5
    return (u >= low) & (u <= camera.width - 0.5 - margin) & (v >= low) & (v <= camera.height - 0.5 - margin)


def rays(camera: Camera, pixels: Float) -> Float:
    """Undistorted normalised coordinates (X / Z, Y / Z) of image points: the inverse of `project_points`, by Newton.

    Args:
        camera: numbers and distortion.
        pixels: shape (..., 2), px.
    Returns:
        shape (..., 2); NaN where no point in front of the camera is seen (beyond the fold of the distortion).
    """
    fold = fold_radius(camera)
    goal = (np.asarray(pixels, dtype=np.float64) - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    goal[..., 0] -= camera.skew / camera.fx * goal[..., 1]
    # A start beyond the fold would walk away; the radial part is concave below it, so that Newton climbs from inside.
    radius = np.linalg.norm(goal, axis=-1, keepdims=True)
    xy = goal * np.minimum(1.0, 0.9 * fold / np.maximum(radius, 1e-300))
    for _ in range(50):
        x, y = xy[..., 0], xy[..., 1]
        by_x, by_y = distortion_slopes(x, y, camera.dist)
        miss = goal - np.stack(distort(x, y, camera.dist), axis=-1)
        det = by_x[0] * by_y[1] - by_y[0] * by_x[1]
        det = np.where(np.abs(det) < 1e-9, 1e-9, det)
        step = np.stack(
            [by_y[1] * miss[..., 0] - by_y[0] * miss[..., 1], by_x[0] * miss[..., 1] - by_x[1] * miss[..., 0]], -1
        )
        length = np.linalg.norm(step / det[..., None], axis=-1, keepdims=True)
        xy = xy + step / det[..., None] * np.minimum(1.0, 0.3 / np.maximum(length, 1e-300))
        if np.nanmax(np.abs(miss)) < 1e-14:
            break
    miss = goal - np.stack(distort(xy[..., 0], xy[..., 1], camera.dist), axis=-1)
    bad = (np.abs(miss).max(axis=-1) > 1e-9) | (np.linalg.norm(xy, axis=-1) >= fold)
    return np.where(bad[..., None], np.nan, xy)


def distortion_slopes(x: Any, y: Any, dist: Any) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """Derivatives of the distorted coordinates by x and by y; SX, float or array as in `distort`."""
    k1, k2, p1, p2, k3 = (dist[i] for i in range(5))
    r2 = x * x + y * y
    radial, slope = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
    cross = x * y * slope + 2 * p1 * x + 2 * p2 * y
    return (radial + x * x * slope + 2 * p1 * y + 6 * p2 * x, cross), (
        cross,
        radial + y * y * slope + 6 * p1 * y + 2 * p2 * x,
    )


def fold_radius(camera: Camera) -> float:
    """Radius of undistorted normalised coordinates at which radial distortion stops growing; inf if it never does.

    The smallest positive root r of 1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6: points beyond it, far outside the view,
    would fold back into the image. Tangential terms are neglected.
    """
    k1, k2, _, _, k3 = camera.dist
    roots = np.roots(np.trim_zeros(np.array([7 * k3, 5 * k2, 3 * k1, 1.0]), "f"))
    real = roots[np.isreal(roots)].real
    positive = real[real > 0]
    return math.sqrt(positive.min()) if positive.size else math.inf
