"""Pose of three known points from one image: all solutions, the likely one, its covariance, and whether to trust it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symcal.camera.camera import Camera, rays
from symcal.camera.perspective_three_point import solve_bearings
from symcal.camera.reproject import moved, reproject, skew
from symcal.errors import InputError, RefusedError

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

DEGENERATE_MARGIN_DEG = 5.0
PREDICTION_LIMIT_DEG = 5.0
_REPRODUCED_PX = 1e-7
_ROUNDING_PX = 1e-11


@dataclass(frozen=True, slots=True)
class P3PResult:
    """Pose of one three-point target.

    Attributes:
        solutions: every T_camera_target that shows its face and reproduces the pixels, shape (k, 4, 4), k in 1..4, mm.
        chosen: index of the solution whose rotation is nearest to the prediction's.
        covariance: of the chosen pose, shape (6, 6): translation along the camera's axes in mm, rotation vector in rad
            applied on the right; infinite on the degenerate cylinder.
        turn_deg: rotation angle from the prediction to each solution, shape (k,).
        tilt_deg: angle between the target's normal and the optical axis.
        incidence_deg: angle between the normal and the line of sight to the centre of the circle through the points.
        beyond_deg: incidence minus that of the degenerate cylinder; negative inside it.
        reason: why the choice is not sure, in a sentence; empty when it is.
    """

    solutions: Float
    chosen: int
    covariance: Float
    turn_deg: Float
    tilt_deg: float
    incidence_deg: float
    beyond_deg: float
    reason: str

    @property
    def T_camera_target(self) -> Float:
        """The chosen pose, shape (4, 4), mm."""
        return cast(Float, self.solutions[self.chosen])

    @property
    def sure(self) -> bool:
        """Whether the chosen solution can be relied on."""
        return not self.reason


def solve_p3p(
    camera: Camera,
    target_points: Float,
    pixels: Float,
    T_predicted: Float,
    sigma_px: ArrayLike = 0.02,
    *,
    normal: ArrayLike | None = None,
) -> P3PResult:
    """Pose of three points from their pixels; the arguments of `solve_p3p_batch` for one image.

    Raises:
        RefusedError: no pose that shows the target's face reproduces the pixels.
    """
    pose = np.asarray(T_predicted, dtype=np.float64)[None]
    result = solve_p3p_batch(camera, target_points, np.asarray(pixels)[None], pose, sigma_px, normal=normal)[0]
    if result is None:
        raise RefusedError(
            "no pose that shows the target's face reproduces these three image points: they may be swapped, "
            "or lie too near to the degenerate cylinder for their noise"
        )
    return result


def solve_p3p_batch(
    camera: Camera,
    target_points: Float,
    pixels: Float,
    T_predicted: Float,
    sigma_px: ArrayLike = 0.02,
    *,
    normal: ArrayLike | None = None,
) -> list[P3PResult | None]:
    r"""Poses of a three-point target in many images.

    The paper's eq. 5 with the known distances: z_i [u_i, v_i, 1]^T = K (R p_i + t), i = 1..3, with lens distortion.
    The closed-form solutions are polished by Newton's method on the reprojection, to rounding; C = J^-1 S J^-T
    by the QR factors of the square pixel Jacobian J. Not sure is a choice that lies within `DEGENERATE_MARGIN_DEG` of
    the cylinder through the points along the target's normal, or inside it (solutions merge there), whose rotation is
    more than `PREDICTION_LIMIT_DEG` away from the prediction, or more than half as far as the next one's.

    Args:
        camera: numbers and distortion.
        target_points: shape (3, 3), mm, target frame.
        pixels: shape (n, 3, 2), px, in the order of the points.
        T_predicted: T_camera_target from the robot's nominal model, shape (n, 4, 4), mm.
        sigma_px: standard deviation of each image coordinate, broadcast to shape (n, 3).
        normal: the side from which the target is seen; default (p2 - p1) x (p3 - p1).
    Returns:
        one result for each image; None where no pose that shows the target's face reproduces the pixels.
    Raises:
        InputError: wrong shapes, numbers that are not finite, or points on one line.
    Source: [Ding2017] eq. 5; choice, covariance and flags are ours.
    """
    points, pixels, predicted = (np.asarray(a, dtype=np.float64) for a in (target_points, pixels, T_predicted))
    n = len(pixels)
    if points.shape != (3, 3) or pixels.shape != (n, 3, 2) or predicted.shape != (n, 4, 4):
        shapes = f"{points.shape}, {pixels.shape}, {predicted.shape}"
        raise InputError("P3P takes points (3, 3), pixels (n, 3, 2) and predicted poses (n, 4, 4)", found=shapes)
    if not all(np.isfinite(a).all() for a in (points, pixels, predicted)):
        raise InputError("P3P needs finite points, pixels and predicted poses")
    area = np.cross(points[1] - points[0], points[2] - points[0])
    if np.linalg.norm(area) < 1e-6 * np.ptp(points, axis=0).max() ** 2:
        raise InputError("the three points of a P3P target must not lie on one line", key="points")
    face = area if normal is None else np.asarray(normal, dtype=np.float64)
    sigma = np.broadcast_to(np.asarray(sigma_px, dtype=np.float64), (n, 3))

    sight = np.concatenate([rays(camera, pixels), np.ones((n, 3, 1))], axis=-1)
    seen = np.isfinite(sight).all(axis=(-1, -2))
    sight = np.where(seen[:, None, None], sight, np.eye(3))
    poses, valid = solve_bearings(sight / np.linalg.norm(sight, axis=-1, keepdims=True), points)
    valid = valid & seen[:, None]
    image, slot = np.nonzero(valid)
    poses[image, slot], valid[image, slot] = _polish(camera, points, pixels[image], poses[image, slot])
    center = points.mean(axis=0)
    away = -(poses[..., :3, :3] @ center + poses[..., :3, 3])
    facing = np.einsum("...i,...i", poses[..., :3, :3] @ face, away) > 0
    valid = _distinct(poses, valid & facing)

    turn = np.where(valid, _angle_deg(poses[..., :3, :3], predicted[:, None, :3, :3]), np.inf)
    chosen = turn.argmin(axis=1)
    found = cast(Bool, valid.any(axis=1))
    best = np.where(found[:, None, None], poses[np.arange(n), chosen], predicted)
    covariance = _covariance(reproject(camera, best, points)[1].reshape(n, 6, 6), sigma)
    tilt, incidence, cylinder = view_angles(points, best, face)

    results: list[P3PResult | None] = []
    for i in range(n):
        if not found[i]:
            results.append(None)
            continue
        beyond, turns = float(incidence[i] - cylinder[i]), turn[i, valid[i]]
        results.append(
            P3PResult(
                solutions=poses[i, valid[i]],
                chosen=int(turns.argmin()),
                covariance=covariance[i],
                turn_deg=turns,
                tilt_deg=float(tilt[i]),
                incidence_deg=float(incidence[i]),
                beyond_deg=beyond,
                reason=_doubt(beyond, turns),
            )
        )
    return results


def points_covariance(result: P3PResult, target_points: Float) -> Float:
    """Covariance of the target's points in the camera frame, all together, shape (3 n, 3 n), mm^2; its rank is 6."""
    points = np.asarray(target_points, dtype=np.float64)
    rotation = result.T_camera_target[:3, :3]
    by_pose = np.concatenate([np.broadcast_to(np.eye(3), (len(points), 3, 3)), -rotation @ skew(points)], axis=-1)
    jacobian = by_pose.reshape(-1, 6)
    return cast(Float, jacobian @ result.covariance @ jacobian.T)


def view_angles(points: Float, T_camera_target: Float, normal: Float) -> tuple[Float, Float, Float]:
    """Tilt, incidence, and the incidence of the degenerate cylinder; all in deg, of shape (...).

    Three points and a camera on the cylinder through them (its axis along their plane's normal) fix no pose: two
    solutions merge. At the distance Z that is the incidence asin(rho / Z), rho the radius of the circle through the
    points; side / sqrt(3) of an equilateral triangle.

    Args:
        points: shape (3, 3), mm.
        T_camera_target: shape (..., 4, 4), mm.
        normal: of the visible face, any length.
    """
    a, b = points[1] - points[0], points[2] - points[0]
    across = np.cross(a, b)
    to_center = np.cross(a @ a * b - b @ b * a, across) / (2 * across @ across)
    center, radius = points[0] + to_center, float(np.linalg.norm(to_center))
    rotation, translation = T_camera_target[..., :3, :3], T_camera_target[..., :3, 3]
    face = rotation @ (across * math.copysign(1.0, across @ normal) / np.linalg.norm(across))
    sight = rotation @ center + translation
    distance = np.linalg.norm(sight, axis=-1)
    tilt = np.arctan2(np.hypot(face[..., 0], face[..., 1]), -face[..., 2])
    incidence = np.arctan2(np.linalg.norm(np.cross(face, sight), axis=-1), -np.einsum("...i,...i", face, sight))
    cylinder = np.arcsin(np.minimum(1.0, radius / distance))
    return np.rad2deg(tilt), np.rad2deg(incidence), np.rad2deg(cylinder)


def _doubt(beyond_deg: float, turn_deg: Float) -> str:
    first, second = (*np.sort(turn_deg), math.inf)[:2]
    if beyond_deg < DEGENERATE_MARGIN_DEG:
        where = f"{beyond_deg:.1f} deg of tilt beyond" if beyond_deg >= 0 else f"{-beyond_deg:.1f} deg of tilt inside"
        return f"the view is {where} the degenerate cylinder of three points, where two poses look alike; tilt it more"
    if first > PREDICTION_LIMIT_DEG:
        return f"the nearest solution is turned by {first:.1f} deg against the prediction: one of them is wrong"
    if second < 2 * first:
        return f"two solutions are almost equally near to the prediction: turned by {first:.1f} and {second:.1f} deg"
    return ""


def _polish(camera: Camera, points: Float, pixels: Float, poses: Float) -> tuple[Float, Bool]:
    """Poses (m, 4, 4) after Newton steps that are kept while they help, and whether they reproduce pixels (m, 3, 2)."""
    poses, worst = poses.copy(), np.full(len(poses), np.inf)
    tried, open_ = poses, np.arange(len(poses))
    for _ in range(10):
        seen, jacobian = reproject(camera, tried, points)
        residual = (pixels[open_] - seen).reshape(-1, 6)
        size = np.abs(residual).max(axis=-1)
        better = (size < worst[open_]) & np.all(tried[:, 2, 3:] > 0, axis=-1)
        poses[open_[better]], worst[open_[better]] = tried[better], size[better]
        going = better & (size > _ROUNDING_PX)
        if not going.any():
            break
        step = _inverse(jacobian[going].reshape(-1, 6, 6)) @ residual[going, :, None]
        open_ = open_[going]
        tried = moved(poses[open_], np.clip(step[..., 0], -1e3, 1e3))
    return poses, worst < _REPRODUCED_PX


def _inverse(jacobian: Float) -> Float:
    """Inverses of 6 x 6 pixel Jacobians by QR, columns scaled to one; huge but finite where singular."""
    scale = np.linalg.norm(jacobian, axis=-2, keepdims=True)
    q, r = np.linalg.qr(jacobian / scale)
    diagonal = np.einsum("...ii->...i", r)
    diagonal[np.abs(diagonal) < 1e-14] = 1e-14
    return cast(Float, np.linalg.solve(r, q.swapaxes(-1, -2)) / scale.swapaxes(-1, -2))


def _covariance(jacobian: Float, sigma: Float) -> Float:
    root = _inverse(jacobian) * np.repeat(sigma, 2, axis=-1)[:, None, :]
    covariance = root @ root.swapaxes(-1, -2)
    singular = np.linalg.norm(root, axis=(-1, -2)) > 1e9 * sigma.max(axis=-1)
    return cast(Float, np.where(singular[:, None, None], np.inf, covariance))


def _distinct(poses: Float, valid: Bool) -> Bool:
    kept = valid.copy()
    for second in range(1, poses.shape[1]):
        for first in range(second):
            apart = np.abs(poses[:, first] - poses[:, second])[:, :3] / np.array([1.0, 1.0, 1.0, 1e3])
            kept[:, second] &= ~(kept[:, first] & (apart.max(axis=(-1, -2)) < 1e-8))
    return kept


def _angle_deg(a: Float, b: Float) -> Float:
    """Rotation angle between rotation matrices, deg; from the chord, accurate at small angles."""
    chord = np.linalg.norm(a - b, axis=(-1, -2)) / (2 * math.sqrt(2))
    return cast(Float, 2 * np.rad2deg(np.arcsin(np.minimum(1.0, chord))))
