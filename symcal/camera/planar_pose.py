r"""Pose of a flat target from one image of four or more of its points: the two solutions, better one first.

With the lens undone, points (x, y, 0) of the target are seen along (u, v, 1) ~ H (x, y, 1), H = [r_1 r_2 t] to scale.
H is the null vector of two equations per point ([Zhang2000]). A flat target that is seen nearly from afar looks the
same turned about the line of sight by half a turn of its normal: from the first solution the second one is started
there ([Schweighofer2006]), and both are refined on the image points. Which one is true, other views must tell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import Camera, rays
from symcal.camera.reproject import moved, reproject
from symcal.spatial import transform

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

_FLAT = 0.02  # points within this share of a line say nothing of the turn about it
_MOST = 24  # points of a view that are enough, spread over those that were seen
_STEPS = 12
_DAMPING = 1e-6
_SETTLED = 1e-6  # share of the squared error by which a step may still lower it


def planar_poses(camera: Camera, points: Float, pixels: Float, normal: Float) -> tuple[Float, Float]:
    """Both poses of a flat target in many images.

    Args:
        points: of the target, z = 0, shape (n, 3), mm. pixels: shape (N, n, 2), px, NaN where a point was not seen.
        normal: of the side that is seen, along z or against it, shape (3,).
    Returns:
        T_camera_target, shape (N, 2, 4, 4), mm, the one of smaller error first; rms distance in the image, shape
        (N, 2), px, infinite where there is none: fewer than four points, all but on a line, or another side is seen.
    """
    points, pixels, seen = _thinned(points, pixels)
    sight = np.where(seen[:, :, None], rays(camera, np.where(seen[:, :, None], pixels, camera.cx)), np.nan)
    seen &= np.isfinite(sight).all(axis=2)
    starts = [_by_homography(p[own, :2], view[own]) for p, view, own in zip(points, sight, seen, strict=True)]
    good = np.array([start is not None for start in starts], dtype=bool)
    poses = np.tile(transform(np.eye(3), np.array([0.0, 0.0, 1e3])), (len(pixels), 2, 1, 1))
    rms = np.full((len(pixels), 2), np.inf)
    if not good.any():
        return poses, rms
    points, pixels, seen = points[good], pixels[good], seen[good]
    begun = np.array([start for start in starts if start is not None])
    first, first_rms = _refined(camera, points, pixels, seen, begun)
    centres = (points * seen[:, :, None]).sum(axis=1) / seen.sum(axis=1)[:, None]
    second, second_rms = _refined(camera, points, pixels, seen, _mirrored(first, centres))
    found = np.stack([first, second], axis=1)
    errors = np.stack([first_rms, second_rms], axis=1)
    to_camera = -(np.einsum("nkij,nj->nki", found[:, :, :3, :3], centres) + found[:, :, :3, 3])
    facing = np.einsum("nki,nki->nk", found[:, :, :3, :3] @ normal, to_camera) > 0
    errors = np.where(facing, errors, np.inf)
    order = np.argsort(errors, axis=1, kind="stable")
    poses[good] = np.take_along_axis(found, order[:, :, None, None], axis=1)
    rms[good] = np.take_along_axis(errors, order, axis=1)
    return poses, rms


def _thinned(points: Float, pixels: Float) -> tuple[Float, Float, Bool]:
    """At most so many points of every view: where they are, (N, m, 3), their images, (N, m, 2), and which were seen."""
    seen: Bool = np.asarray(np.isfinite(pixels).all(axis=2))
    kept = np.zeros((len(pixels), min(_MOST, len(points))), dtype=np.intp)
    mask = np.zeros(kept.shape, dtype=np.bool_)
    for i, own in enumerate(seen):
        index = np.flatnonzero(own)
        index = (
            index[np.unique(np.linspace(0, len(index) - 1, kept.shape[1]).round().astype(int))] if index.size else index
        )
        kept[i, : len(index)], mask[i, : len(index)] = index, True
    return points[kept], np.take_along_axis(pixels, kept[:, :, None], axis=1), mask


def _by_homography(points: Float, sight: Float) -> Float | None:
    """T_camera_target, shape (4, 4), from points (k, 2) seen along (k, 2); None where they do not tell it."""
    if len(points) < 4:
        return None
    (first, first_size), (second, second_size) = _normalised(points), _normalised(sight)
    spread = np.linalg.svd(first, compute_uv=False)
    if spread[1] < _FLAT * spread[0]:
        return None
    x, y = first.T
    one, zero = np.ones_like(x), np.zeros((len(x), 3))
    plain = np.stack([x, y, one], axis=1)
    rows = np.concatenate(
        [
            np.hstack([plain, zero, -second[:, :1] * plain]),
            np.hstack([zero, plain, -second[:, 1:] * plain]),
        ]
    )
    h = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3)
    h = np.linalg.inv(second_size) @ h @ first_size
    h *= np.sign(h[2] @ np.append(points.mean(axis=0), 1.0)) / np.sqrt(
        np.linalg.norm(h[:, 0]) * np.linalg.norm(h[:, 1])
    )
    u, _, vt = np.linalg.svd(np.column_stack([h[:, 0], h[:, 1], np.cross(h[:, 0], h[:, 1])]))
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return transform(rotation, h[:, 2])


def _normalised(points: Float) -> tuple[Float, Float]:
    """Points about their centre at a mean distance of one, and the matrix that makes them so ([Hartley1997])."""
    centre = points.mean(axis=0)
    size = float(np.linalg.norm(points - centre, axis=1).mean())
    matrix = np.array([[1 / size, 0.0, -centre[0] / size], [0.0, 1 / size, -centre[1] / size], [0.0, 0.0, 1.0]])
    return (points - centre) / size, matrix


def _mirrored(poses: Float, centres: Float) -> Float:
    """Poses whose normal is turned to the other side of the line of sight to a point, which stays, (N, 4, 4)."""
    at = np.einsum("nij,nj->ni", poses[:, :3, :3], centres) + poses[:, :3, 3]
    sight = at / np.linalg.norm(at, axis=1, keepdims=True)
    # twice the reflection: in the plane across the sight, then in the target's own
    across = np.eye(3) - 2 * sight[:, :, None] * sight[:, None, :]
    turned = across @ poses[:, :3, :3] @ np.diag([1.0, 1.0, -1.0])
    out = poses.copy()
    out[:, :3, :3] = turned
    out[:, :3, 3] = at - np.einsum("nij,nj->ni", turned, centres)
    return out


def _refined(camera: Camera, points: Float, pixels: Float, seen: Bool, poses: Float) -> tuple[Float, Float]:
    """Poses of least squared error in the image, all at once by damped Gauss-Newton steps, and that error (rms), px."""
    goal = np.where(seen[:, :, None], pixels, 0.0)

    def at(tried: Float) -> tuple[Float, Float, Float]:
        image, jacobian = reproject(camera, tried, points)
        front = (np.einsum("nj,nkj->nk", tried[:, 2, :3], points) + tried[:, 2, 3:] > 0) & seen
        residual = np.where(seen[:, :, None], image - goal, 0.0).reshape(len(tried), -1)
        lost = (seen & ~front).any(axis=1) | ~np.isfinite(residual).all(axis=1)
        squares = np.where(lost, np.inf, np.sum(residual**2, axis=1))
        return residual, np.where(seen[:, :, None, None], jacobian, 0.0).reshape(len(tried), -1, 6), squares

    residual, jacobian, squares = at(poses)
    damping = np.full(len(poses), _DAMPING)
    for _ in range(_STEPS):
        normal = jacobian.swapaxes(1, 2) @ jacobian
        diagonal = np.einsum("nii->ni", normal)
        normal = normal + (damping[:, None] * diagonal + 1e-12)[:, :, None] * np.eye(6)
        gradient = jacobian.swapaxes(1, 2) @ residual[:, :, None]
        step = np.nan_to_num(-np.linalg.solve(normal, gradient)[..., 0])
        tried = moved(poses, step)
        residual_there, jacobian_there, squares_there = at(tried)
        better = squares_there < squares
        gain = -np.einsum("ni,ni->n", step, gradient[..., 0])  # about twice what the step should bring
        poses = np.where(better[:, None, None], tried, poses)
        residual = np.where(better[:, None], residual_there, residual)
        jacobian = np.where(better[:, None, None], jacobian_there, jacobian)
        squares = np.where(better, squares_there, squares)
        damping = np.where(better, damping / 10, np.maximum(damping, _DAMPING) * 100)
        if not (gain > _SETTLED * squares).any():
            break
    return poses, np.sqrt(squares / np.maximum(seen.sum(axis=1), 1))
