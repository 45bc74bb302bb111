"""How well a camera is known: covariance of its intrinsics, and what it means in the image."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import NUMBER_NAMES, Camera, rays
from symcal.errors import RefusedError

Float = NDArray[np.float64]
Pose = tuple[Float, Float]
"""Rotation vector (rad) and translation (mm) of a board in the camera."""

GRID = (6, 8)
"""Rows and columns of the coverage map."""


def projected(camera: Camera, pose: Pose, points: Float) -> Float:
    """Image points of points of the board, shape (n, 2), px."""
    return _project(camera, pose, points)[0]


def projection_jacobian(camera: Camera, pose: Pose, points: Float) -> Float:
    """Derivative of the image points, u and v in turn, by rotation vector, shift and `NUMBER_NAMES`; (2 n, 16)."""
    return _project(camera, pose, points)[1]


def _project(camera: Camera, pose: Pose, points: Float) -> tuple[Float, Float]:
    """Image points and derivatives by OpenCV, which has no skew: it adds skew (v - cy) / fy to u."""
    image, slopes = cv2.projectPoints(points, *pose, camera.matrix, np.array(camera.dist))
    pixels = np.asarray(image, dtype=np.float64).reshape(-1, 2)
    jacobian = np.column_stack([np.asarray(slopes, dtype=np.float64)[:, :15], np.zeros(2 * len(pixels))])
    down = (pixels[:, 1] - camera.cy) / camera.fy
    jacobian[::2, 15] = down
    if camera.skew:
        pixels[:, 0] += camera.skew * down
        by_v = jacobian[1::2, :15] / camera.fy
        by_v[:, 6:10] = 0.0  # the normalised coordinate does not depend on focal lengths and principal point
        jacobian[::2, :15] += camera.skew * by_v
    return pixels, jacobian


def intrinsic_covariance(
    camera: Camera,
    poses: Sequence[Pose],
    points: Sequence[Float],
    residuals: Float,
    *,
    free: NDArray[np.bool_],
    free_points: NDArray[np.bool_] | None = None,
) -> Float:
    """Covariance of the ten `NUMBER_NAMES`, poses (and the board's shape) marginalised; zero rows where held.

    Each view's Jacobian is projected off that by its pose; a QR of the stack, intrinsics last, gives
    sigma^2 (R^T R)^-1 from its last block, sigma^2 being the squared residuals over the degrees of freedom
    (coordinates minus unknowns).

    Args:
        camera: the estimate.
        poses: of the board, one per view.
        points: seen in each view, in the board frame, shape (n, 3), mm.
        residuals: of all views, shape (m, 2), px.
        free: which of the numbers were estimated, shape (10,).
        free_points: which coordinates of the board's points were estimated, shape (n, 3) (every view sees all of them).
    Returns:
        shape (10, 10).
    Raises:
        RefusedError: the views leave a number undetermined.
    """
    count = int(free.sum())
    rows = []
    for pose, seen in zip(poses, points, strict=True):
        basis, _, wanted = view_jacobians(camera, pose, seen, free, free_points)
        rows.append(wanted - basis @ (basis.T @ wanted))
    stack = np.concatenate(rows)
    freedom = residuals.size - stack.shape[1] - 6 * len(poses)
    if freedom <= 0:
        raise RefusedError("the views have too few points to determine the camera")
    scale = np.maximum(np.linalg.norm(stack, axis=0), np.finfo(float).tiny)
    triangle = np.linalg.qr(stack / scale, mode="r")
    if np.linalg.cond(triangle) > 1e10:
        raise RefusedError("the views do not determine the camera: tilt the board by 30 to 45 deg in several views")
    inverse = np.asarray(np.linalg.inv(triangle)[-count:, -count:], dtype=np.float64) / scale[-count:, None]
    covariance = np.zeros((len(NUMBER_NAMES), len(NUMBER_NAMES)))
    covariance[np.ix_(free, free)] = inverse @ inverse.T * (np.sum(residuals**2) / freedom)
    return covariance


def projection_sigma(camera: Camera, grid: tuple[int, int] = GRID) -> Float:
    """Error to expect of the projection of a far point in each cell of the image, px, shape `grid`.

    sqrt(tr(J C J^T)) with the covariance C of the intrinsics; the rotation of the camera that hides most of it is taken
    out first, because whoever uses the camera estimates its rotation anyway. NaN where the lens shows nothing.

    Args:
        camera: with its covariance.
        grid: rows and columns.
    Source: the idea of projection uncertainty in mrcal; compensation by a rotation over the whole image is ours.
    """
    rows, columns = grid
    u = (np.arange(columns) + 0.5) * camera.width / columns - 0.5
    v = (np.arange(rows) + 0.5) * camera.height / rows - 0.5
    ray = rays(camera, np.stack(np.meshgrid(u, v), axis=-1)).reshape(-1, 2)
    seen = np.isfinite(ray[:, 0])
    sigma = np.full(seen.shape, np.nan)
    points = np.column_stack([ray[seen], np.ones(seen.sum())])
    jacobian = projection_jacobian(camera, (np.zeros(3), np.zeros(3)), points)
    turn, _ = np.linalg.qr(jacobian[:, :3])
    rest = jacobian[:, 6:] - turn @ (turn.T @ jacobian[:, 6:])
    covariance = np.zeros((9, 9)) if camera.covariance is None else camera.covariance
    rest = rest[:, : len(covariance)]
    sigma[seen] = np.sqrt(np.einsum("ij,jk,ik->i", rest, covariance, rest).reshape(-1, 2).sum(axis=1))
    return sigma.reshape(grid)


def view_jacobians(
    camera: Camera, pose: Pose, points: Float, free: NDArray[np.bool_], free_points: NDArray[np.bool_] | None
) -> tuple[Float, Float, Float]:
    """Derivatives of one view: Q and R of that by its pose, and that by the points and the camera's free numbers."""
    jacobian = projection_jacobian(camera, pose, points)
    basis, triangle = np.linalg.qr(jacobian[:, :6])
    shared = jacobian[:, 6:][:, free]
    if free_points is not None:
        shared = np.hstack([_by_points(jacobian, pose)[:, free_points.ravel()], shared])
    return basis, triangle, shared


def _by_points(jacobian: Float, pose: Pose) -> Float:
    """Derivative by the coordinates of the board's points, (2 n, 3 n): that by the translation, in the board's axes."""
    rotation, _ = cv2.Rodrigues(pose[0])
    own = (jacobian[:, 3:6] @ rotation).reshape(-1, 2, 3)
    result = np.zeros((len(own), 2, len(own), 3))
    each = np.arange(len(own))
    result[each, :, each] = own
    return result.reshape(2 * len(own), 3 * len(own))
