"""The outline of a disc: predicted from its pose, and found in the image to a fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree
from scipy.special import ndtr

from symcal.camera.camera import Camera, project_points

Float = NDArray[np.float64]

_POINTS_PER_PX = 3
_PIXEL_SIGMA = 12**-0.5  # of a pixel's square
_SYSTEMATIC_PX = 0.001
_ITERATIONS = 15
_OUTLIER = 4.0  # robust standard deviations
_MISMATCH = 0.25  # of the contrast, which pixels of an edge of another shape than Phi may miss


@dataclass(frozen=True, slots=True)
class Outline:
    """Image of a disc's rim.

    Attributes:
        points: about three per pixel of its length, shape (m, 2), px.
        normals: outward, shape (m, 2).
        centroid: of the enclosed area, shape (2,), px.
        projected: image of the disc's centre, shape (2,), px; not the centroid under perspective or distortion.
        area: enclosed, px^2.
        minor: smallest distance from the centroid to the rim, px.
    """

    points: Float
    normals: Float
    centroid: Float
    projected: Float
    area: float
    minor: float


@dataclass(frozen=True, slots=True)
class RimFit:
    """How a predicted outline must move and stretch to lie on the edge in the image.

    Attributes:
        shift: of its centroid, shape (2,), px.
        growth: mean relative change of its size.
        sigma_px: of the shift, per axis.
        blur_px: sigma of the edge's profile, without that of a pixel's square.
        contrast: inside minus outside, grey levels.
        fit: share of the pixels that look as they should.
    """

    shift: Float
    growth: float
    sigma_px: float
    blur_px: float
    contrast: float
    fit: float


def predict_outline(
    camera: Camera, T_camera_target: Float, point: Float, normal: Float, radius: float, *, sphere: bool = False
) -> Outline | None:
    """Outline of a disc, or of a sphere, at a pose.

    A sphere is seen as the disc on which the rays of sight touch it: across the line of sight, a little nearer.

    Args:
        camera: numbers and distortion.
        T_camera_target: shape (4, 4), mm.
        point: centre in the target frame, shape (3,), mm.
        normal: of the disc's face, in the target frame, shape (3,); not used for a sphere.
        radius: mm.
        sphere: whether it is one.
    Returns:
        None if part of it is behind the camera or beyond the fold of the distortion.
    """
    center = T_camera_target[:3, :3] @ point + T_camera_target[:3, 3]
    axis, middle = T_camera_target[:3, :3] @ normal, center
    if sphere:
        distance = float(np.linalg.norm(center))
        shrink = 1 - min(radius / distance, 0.999) ** 2
        axis, middle, radius = center / distance, center * shrink, radius * np.sqrt(shrink)
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    length = 2 * np.pi * radius * camera.fx / max(float(center[2]), radius)
    angles = np.linspace(0, 2 * np.pi, int(np.clip(_POINTS_PER_PX * length, 96, 4000)), endpoint=False)
    rim = middle + radius * (np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second)
    points, projected = project_points(camera, rim), project_points(camera, center)
    if not (np.all(np.isfinite(points)) and np.all(np.isfinite(projected))):
        return None
    after = np.roll(points, -1, axis=0)
    origin = points.mean(axis=0)
    p, q = points - origin, after - origin
    cross = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
    centroid = origin + ((p + q) * cross[:, None]).sum(axis=0) / (3 * cross.sum())
    tangent = after - np.roll(points, 1, axis=0)
    normals = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1) * np.sign(cross.sum())
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    minor = float(np.abs(np.sum((points - centroid) * normals, axis=1)).min())
    return Outline(points, normals, centroid, projected, abs(float(cross.sum())) / 2, minor)


def fit_rim(image: NDArray[np.float32], outline: Outline, half_width: float, blur_px: float = 1.0) -> RimFit:
    r"""Move and stretch a predicted outline until the blurred disc that it bounds looks like the image.

    I = o + (i - o) Phi((e - d) / sigma) for every pixel at the signed distance d from the predicted outline, whose
    normal there is n; the levels i, o = a + b n_x + c n_y follow the shading; e = n (s + S r) is the outline's
    displacement by a shift s and a symmetric stretch S of the arm r. Twelve unknowns with sigma, some thousand pixels
    with independent noise: Gauss-Newton with pixels beyond the noise left out, and the covariance that belongs to it.

    Args:
        image: grey levels, shape (height, width).
        outline: near the edge, by less than half_width.
        half_width: of the band of pixels around the outline, px; it must reach no other edge nor the border.
        blur_px: first guess of the edge's sigma.
    """
    pixels, values = _band(image, outline, half_width)
    nearest = np.asarray(cKDTree(outline.points).query(pixels)[1], dtype=np.intp)
    normal = outline.normals[nearest]
    distance = np.sum((pixels - outline.points[nearest]) * normal, axis=1)
    keep = np.abs(distance) <= half_width
    distance, values, nearest, normal = distance[keep], values[keep], nearest[keep], normal[keep]
    arm = (outline.points - outline.centroid)[nearest]
    size = float(np.linalg.norm(arm, axis=1).mean())
    nx, ny = normal.T
    x, y = arm.T / size
    moves = np.column_stack([nx, ny, nx * x, ny * y, nx * y + ny * x])
    shading = np.column_stack([np.ones(len(normal)), normal])

    rim = np.zeros(5)
    sigma = float(np.hypot(blur_px, _PIXEL_SIGMA))
    inside, outside = (np.array([np.median(values[far]), 0.0, 0.0]) for far in _ends(distance, half_width))
    good = np.ones(len(values), dtype=bool)
    rows, residual, noise, contrast = np.zeros((len(values), 12)), values, 0.0, np.zeros(len(values))
    for _ in range(_ITERATIONS):
        z = (distance - moves @ rim) / sigma
        share, density = ndtr(-z), np.exp(-z * z / 2) / np.sqrt(2 * np.pi)
        contrast = shading @ (inside - outside)
        residual = values - shading @ outside - contrast * share
        slope = contrast * density / sigma
        rows = np.column_stack(
            [shading * share[:, None], shading * (1 - share)[:, None], moves * slope[:, None], slope * z]
        )
        noise = 1.4826 * float(np.median(np.abs(residual)))
        good = np.abs(residual) <= max(_OUTLIER * noise, _MISMATCH * abs(float(contrast.mean())))
        step = np.linalg.lstsq(rows[good], residual[good], rcond=None)[0]
        step[6:] *= min(1.0, half_width / 2 / max(float(np.abs(step[6:]).max()), 1e-9))
        inside, outside, rim = inside + step[:3], outside + step[3:6], rim + step[6:11]
        sigma = float(np.clip(sigma + step[11], sigma / 2, sigma * 2))
        sigma = float(np.clip(sigma, _PIXEL_SIGMA, half_width))
        if float(np.abs(step[6:]).max()) < 1e-4:
            break
    variance = float(np.mean(residual[good] ** 2))
    free = max(int(good.sum()) - rows.shape[1], 1)
    covariance = np.linalg.pinv(rows[good].T @ rows[good]) * variance * len(residual[good]) / free
    return RimFit(
        shift=rim[:2],
        growth=float(rim[2] + rim[3]) / (2 * size),
        sigma_px=float(np.sqrt((covariance[6, 6] + covariance[7, 7]) / 2 + _SYSTEMATIC_PX**2)),
        blur_px=float(np.sqrt(max(sigma**2 - _PIXEL_SIGMA**2, 0.0))),
        contrast=float(contrast.mean()),
        fit=float(good.mean()),
    )


def _band(image: NDArray[np.float32], outline: Outline, half_width: float) -> tuple[Float, Float]:
    """Pixels at most a little farther than half_width from the outline, and their grey levels."""
    reach = int(np.ceil(half_width)) + 1
    height, width = image.shape
    left, top = np.maximum(np.floor(outline.points.min(axis=0)).astype(int) - reach, 0)
    right, bottom = np.minimum(np.ceil(outline.points.max(axis=0)).astype(int) + reach + 1, [width, height])
    mask = np.zeros((bottom - top, right - left), dtype=np.uint8)
    cv2.polylines(mask, [np.round(outline.points - [left, top]).astype(np.int32)], True, 1, thickness=2 * reach)
    rows, columns = np.nonzero(mask)
    pixels = np.stack([columns + left, rows + top], axis=1).astype(np.float64)
    return pixels, image[rows + top, columns + left].astype(np.float64)


def _ends(distance: Float, half_width: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Pixels at the inner and at the outer end of the band."""
    return distance < -0.7 * half_width, distance > 0.7 * half_width


def sample(image: NDArray[np.float32], pixels: Float) -> Float:
    """Grey values at pixels, shape (..., 2), by bilinear interpolation; beyond the image its border goes on."""
    u, v = pixels[..., 0], pixels[..., 1]
    left, top = max(int(u.min()) - 1, 0), max(int(v.min()) - 1, 0)
    patch = image[top : int(v.max()) + 3, left : int(u.max()) + 3]
    return np.asarray(map_coordinates(patch, [v - top, u - left], output=np.float64, order=1, mode="nearest"))
