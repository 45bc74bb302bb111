"""Image points of a target at a pose, their derivatives, and the pose that reproduces given image points.

A pose increment is (dx, dy, dz, rx, ry, rz): a translation along the camera's axes in mm, and a rotation vector in
rad applied on the right, T = [R exp(r), t + d]. Every function works on stacks of poses.
"""

from __future__ import annotations

from typing import cast

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.camera.camera import Camera, distort, distortion_slopes

Float = NDArray[np.float64]


def reproject(camera: Camera, T_camera_target: Float, points: Float) -> tuple[Float, Float]:
    """Image points of target points and their derivative with respect to a pose increment.

    Args:
        camera: numbers and distortion.
        T_camera_target: shape (..., 4, 4), mm.
        points: in the target frame, shape (n, 3), or (..., n, 3) of every pose its own; mm; all in front of the camera.
    Returns:
        pixels, shape (..., n, 2), px; Jacobian, shape (..., n, 2, 6), px/mm and px/rad.
    """
    rotation, translation = T_camera_target[..., None, :3, :3], T_camera_target[..., None, :3, 3]
    x, y, z = np.moveaxis((rotation @ points[..., None])[..., 0] + translation, -1, 0)
    u, v = x / z, y / z
    xd, yd = distort(u, v, camera.dist)
    by_u, by_v = (np.stack(slopes, axis=-1) for slopes in distortion_slopes(u, v, camera.dist))
    axes = camera.matrix[:2, :2]
    pixels = np.stack([xd, yd], axis=-1) @ axes.T + np.array([camera.cx, camera.cy])
    by_point = np.stack([by_u, by_v, -(by_u * u[..., None] + by_v * v[..., None])], axis=-1)
    by_point = axes @ by_point / z[..., None, None]
    jacobian = np.concatenate([by_point, -by_point @ rotation @ skew(points)], axis=-1)
    return pixels, jacobian


def moved(T_camera_target: Float, increment: Float) -> Float:
    """Poses after the increments, shape (..., 6); rotations are kept orthonormal to rounding."""
    shape = increment.shape[:-1]
    turn = scipy.spatial.transform.Rotation.from_rotvec(increment[..., 3:].reshape(-1, 3))
    start = scipy.spatial.transform.Rotation.from_matrix(T_camera_target[..., :3, :3].reshape(-1, 3, 3))
    result = np.array(np.broadcast_to(T_camera_target, (*shape, 4, 4)))
    result[..., :3, :3] = (start * turn).as_matrix().reshape(*shape, 3, 3)
    result[..., :3, 3] += increment[..., :3]
    return result


def fit_pose(
    camera: Camera,
    T_predicted: Float,
    points: Float,
    pixels: Float,
    *,
    sigma_px: float = 0.05,
    sigma_mm: float = 30.0,
    sigma_rad: float = 0.05,
) -> Float:
    """Most probable pose near a prediction: the image points' squared errors, and the prediction as a weak prior.

    The prior leaves a well seen pose alone and carries the directions that the points do not see (the view along
    the degenerate cylinder of three points, or fewer than three of them).

    Args:
        camera: numbers and distortion.
        T_predicted: T_camera_target, shape (4, 4), mm.
        points: shape (n, 3), mm, target frame.
        pixels: shape (n, 2), px.
        sigma_px: of the image points.
        sigma_mm: of the prediction, per axis.
        sigma_rad: likewise.
    Returns:
        T_camera_target, shape (4, 4).
    """
    prior = 1 / np.array([sigma_mm] * 3 + [sigma_rad] * 3)
    pose, total = T_predicted, np.zeros(6)
    for _ in range(10):
        seen, jacobian = reproject(camera, pose, points)
        rows = np.concatenate([jacobian.reshape(-1, 6) / sigma_px, np.diag(prior)])
        residual = np.concatenate([(pixels - seen).ravel() / sigma_px, -prior * total])
        step = np.linalg.lstsq(rows / prior, residual, rcond=None)[0] / prior
        pose, total = moved(pose, step), total + step
        if np.abs(step * prior).max() < 1e-6:
            break
    return pose


def skew(vectors: Float) -> Float:
    """Matrices [v]x of vectors v, shape (..., 3) -> (..., 3, 3), with [v]x w = v x w."""
    return cast(Float, np.cross(np.eye(3), vectors[..., None, :]))
