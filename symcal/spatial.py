"""Rotations and rigid transforms, symbolic and numeric.

The symbolic half takes and gives CasADi SX and is smooth where it is used: the exponential at the zero vector, the
logarithm at the identity and at half a turn are guarded at the point itself. The numeric half serves the edge (files,
closed-form registration) and is its own: SciPy's takes a tenth of a second to load.

Frames: `T_a_b` is the pose of b in a, shape (4, 4), translation in mm.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError

SX = ca.SX
Array = NDArray[np.float64]

_TINY = 1e-8  # squared angle below which the series is exact to rounding (next term: 1e-8**2 / 120)
_ROUNDING = 2.0**-51  # of a sine or cosine at a multiple of 90 deg: sin(pi) and cos(3/2 pi) in double are below it
_GIMBAL_LOCK = 1e-7  # cosine of pitch below which roll and yaw are one angle


def _exact(value: Any) -> SX:
    """Zero for what rounding leaves of the cosine of a constant right angle: products with it leave the expression."""
    value = SX(value)
    return SX(0) if value.is_constant() and abs(float(value)) < _ROUNDING else value


def rotation(axis: int, angle: Any) -> SX:
    """Rotation matrix about coordinate axis 0 (x), 1 (y) or 2 (z); angle in rad; shape (3, 3)."""
    c, s = _exact(ca.cos(angle)), _exact(ca.sin(angle))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = SX(3, 3)
    matrix[axis, axis] = 1
    matrix[i, i], matrix[j, j], matrix[j, i], matrix[i, j] = c, c, s, -s
    return matrix


def skew(v: SX) -> SX:
    """Matrix of the cross product, `skew(v) @ w == v x w`; shape (3, 3)."""
    return ca.vertcat(
        ca.horzcat(0, -v[2], v[1]),
        ca.horzcat(v[2], 0, -v[0]),
        ca.horzcat(-v[1], v[0], 0),
    )


def _series(theta2: SX, exact: Any, series: Any) -> SX:
    """`exact(theta)` away from zero, `series(theta**2)` near it; the unused branch never sees the singular point."""
    small = theta2 < _TINY
    safe = ca.sqrt(ca.if_else(small, 1.0, theta2))
    return ca.if_else(small, series(theta2), exact(safe))


def exp_rotation(r: SX) -> SX:
    """Rotation matrix, shape (3, 3), of the rotation vector r (rad): Rodrigues' formula, differentiable at zero."""
    theta2 = ca.dot(r, r)
    a = _series(theta2, lambda t: ca.sin(t) / t, lambda t2: 1 - t2 / 6)
    b = _series(theta2, lambda t: 2 * (ca.sin(t / 2) / t) ** 2, lambda t2: 0.5 - t2 / 24)
    k = skew(r)
    return SX.eye(3) + a * k + b * (k @ k)


def left_jacobian(r: SX) -> SX:
    """Angular velocity, in the frame before the rotation, per rate of the rotation vector r; shape (3, 3).

    exp(r + dr) = exp(J_l(r) dr) exp(r) to first order. Source: [Sola2018] eq. 145.
    """
    theta2 = ca.dot(r, r)
    b = _series(theta2, lambda t: 2 * (ca.sin(t / 2) / t) ** 2, lambda t2: 0.5 - t2 / 24)
    c = _series(theta2, lambda t: (t - ca.sin(t)) / t**3, lambda t2: 1 / 6 - t2 / 120)
    k = skew(r)
    return SX.eye(3) + b * k + c * (k @ k)


def log_rotation(matrix: SX) -> SX:
    """Rotation vector (rad), shape (3,), of a rotation matrix; its norm is the angle in [0, pi].

    Goes through the quaternion whose largest component is taken from the linear relation 4 q q^T = f(R), so it is
    exact at the identity and at half a turn alike (there the sign of the axis is arbitrary, as it must be).
    """
    m = matrix
    rows = (  # columns of 4 q q^T with q = (w, x, y, z); each is 4 q_k q
        (1 + m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]),
        (m[2, 1] - m[1, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0]),
        (m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], 1 - m[0, 0] + m[1, 1] - m[2, 2], m[2, 1] + m[1, 2]),
        (m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2]),
    )
    q, largest = ca.vertcat(*rows[0]), rows[0][0]
    for k in (1, 2, 3):
        better = rows[k][k] > largest
        q = ca.if_else(better, ca.vertcat(*rows[k]), q)
        largest = ca.if_else(better, rows[k][k], largest)
    q = q / ca.sqrt(ca.dot(q, q))
    q = ca.if_else(q[0] < 0, -q, q)
    w, v = q[0], q[1:]
    s2 = ca.dot(v, v)
    small = s2 < _TINY
    s = ca.sqrt(ca.if_else(small, 1.0, s2))
    # near zero w = sqrt(1 - s2) and 2 asin(s) / s = 2 + s2 / 3
    return ca.if_else(small, 2 + s2 / 3, 2 * ca.atan2(s, w) / s) * v


def right_jacobian_inverse(r: SX) -> SX:
    """Rate of the rotation vector per body-frame angular velocity; shape (3, 3).

    log(exp(r) exp(dw)) = r + J_r^-1(r) dw to first order. Source: [Sola2018] eq. 144.
    """
    theta2 = ca.dot(r, r)
    c = _series(
        theta2,
        lambda t: (1 - (t / 2) * ca.cos(t / 2) / ca.sin(t / 2)) / t**2,
        lambda t2: 1 / 12 + t2 / 720,
    )
    k = skew(r)
    return SX.eye(3) + 0.5 * k + c * (k @ k)


def quaternion_matrix(q: SX) -> SX:
    """Rotation matrix, shape (3, 3), of a quaternion (x, y, z, w) of any length but zero and either sign."""
    q = q / ca.sqrt(ca.dot(q, q))
    v, w = q[:3], q[3]
    k = skew(v)
    return SX.eye(3) + 2 * w * k + 2 * (k @ k)


def transform(rotation_matrix: Array, translation: Array) -> Array:
    """Numeric T_a_b, shape (4, 4), from R_a_b (3, 3) and the origin of b in a (3,), mm."""
    t = np.eye(4)
    t[:3, :3] = rotation_matrix
    t[:3, 3] = translation
    return t


def inverse(t: Array) -> Array:
    """Inverse of rigid transforms, shape (..., 4, 4)."""
    out = np.zeros_like(t)
    out[..., :3, :3] = np.swapaxes(t[..., :3, :3], -1, -2)
    out[..., :3, 3] = -np.einsum("...ji,...j->...i", t[..., :3, :3], t[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def rpy_matrix(rpy: Array) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll), URDF's convention; rpy (..., 3) in rad; shape (..., 3, 3)."""
    rpy = np.asarray(rpy, dtype=np.float64)
    (sr, sp, sy), (cr, cp, cy) = (np.moveaxis(f(rpy), -1, 0) for f in (np.sin, np.cos))
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def matrix_rpy(matrix: Array) -> Array:
    """Roll, pitch, yaw (rad), shape (..., 3), of rotation matrices (..., 3, 3); in gimbal lock yaw is set to zero."""
    m = np.asarray(matrix, dtype=np.float64)
    level = np.hypot(m[..., 0, 0], m[..., 1, 0])
    locked = level < _GIMBAL_LOCK
    roll = np.where(locked, np.arctan2(-m[..., 1, 2], m[..., 1, 1]), np.arctan2(m[..., 2, 1], m[..., 2, 2]))
    yaw = np.where(locked, 0.0, np.arctan2(m[..., 1, 0], m[..., 0, 0]))
    return np.stack([roll, np.arctan2(-m[..., 2, 0], level), yaw], axis=-1)


def vector_matrix(vector: Array) -> Array:
    """Rotation matrices, shape (..., 3, 3), of rotation vectors (..., 3), rad: through the quaternion."""
    vector = np.asarray(vector, dtype=np.float64)
    half = np.linalg.norm(vector, axis=-1, keepdims=True) / 2
    axis = vector * np.sinc(half / np.pi) / 2  # sin(half) / half, one at zero
    return quaternion_matrices(np.concatenate([axis, np.cos(half)], axis=-1))


def matrix_vectors(matrix: Array) -> Array:
    """Rotation vectors, shape (..., 3), rad, of rotation matrices (..., 3, 3); their norm is the angle in [0, pi].

    Through the quaternion, as SciPy does it, whose `scipy.spatial` takes a fifth of a second to load.
    """
    q = matrix_quaternions(matrix)
    length = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    scalar = q[..., 3:]
    turned = length > 0
    ratio = 2 * np.arctan2(length, scalar) / np.where(turned, length, 1.0)
    return np.asarray(q[..., :3] * np.where(turned, ratio, 2.0))


def quaternion_matrices(quaternion: Array) -> Array:
    """Rotation matrices, shape (..., 3, 3), of quaternions (x, y, z, w), shape (..., 4), of any length but zero."""
    q = np.asarray(quaternion, dtype=np.float64)
    x, y, z, w = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [x * x - y * y - z * z + w * w, 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), y * y - x * x - z * z + w * w, 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), z * z - x * x - y * y + w * w],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def matrix_quaternions(matrix: Array) -> Array:
    """Quaternions (x, y, z, w), shape (..., 4), of rotation matrices (..., 3, 3); the scalar part is never negative.

    Every column of 4 q q^T, which is linear in the matrix, is q times a component: the one of the largest is taken.
    """
    m = np.asarray(matrix, dtype=np.float64)
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    square = np.empty((*m.shape[:-2], 4, 4))
    square[..., :3, :3] = m + np.swapaxes(m, -1, -2)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        square[..., i, i] = 1 + 2 * m[..., i, i] - trace
        square[..., i, 3] = square[..., 3, i] = m[..., k, j] - m[..., j, k]
    square[..., 3, 3] = 1 + trace
    largest = np.argmax(np.diagonal(square, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(square, largest[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(_leading(q)[..., None] < 0, -q, q))


def mean_rotation(matrices: Array) -> Array:
    """The rotation matrix, shape (3, 3), of least summed squared chords to rotation matrices (N, 3, 3): its quaternion
    is the first eigenvector of sum_i q_i q_i^T ([Markley2007])."""
    q = matrix_quaternions(matrices)
    return quaternion_matrices(np.linalg.svd(q, full_matrices=False)[2][0])


def _leading(q: Array) -> Array:
    """The scalar part of quaternions, or at half a turn the first component that is not zero, shape (...)."""
    ordered = q[..., [3, 0, 1, 2]]
    first = np.argmax(ordered != 0, axis=-1)
    return np.asarray(np.take_along_axis(ordered, first[..., None], axis=-1)[..., 0])


def pose_matrix(pose: Array) -> Array:
    """T, shape (..., 4, 4), of poses (x, y, z, qx, qy, qz, qw), shape (..., 7), mm."""
    t = np.zeros((*pose.shape[:-1], 4, 4))
    t[..., :3, :3] = quaternion_matrices(pose[..., 3:])
    t[..., :3, 3] = pose[..., :3]
    t[..., 3, 3] = 1.0
    return t


def matrix_pose(t: Array) -> Array:
    """Poses (x, y, z, qx, qy, qz, qw), shape (..., 7), mm, of T (..., 4, 4); the scalar part is never negative."""
    return np.concatenate([t[..., :3, 3], matrix_quaternions(t[..., :3, :3])], axis=-1)


def signed_permutations() -> Iterator[tuple[tuple[int, ...], tuple[float, ...], Array]]:
    """All turns and mirrors of axes onto axes: order and signs of the rows, and the matrix, shape (3, 3)."""
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        yield order, signs, np.eye(3)[list(order)] * np.array(signs)[:, None]


def look_at(eye: Array, goal: Array, up: Array = np.array([0.0, 0.0, 1.0])) -> Array:
    """T_world_camera of a camera at ``eye`` that looks at ``goal``, upright with respect to ``up``; (4, 4), mm.

    Raises:
        InputError: the view is along ``up``, or eye and goal are the same point.
    """
    z = np.asarray(goal, dtype=np.float64) - eye
    x = np.cross(z, up)
    if np.linalg.norm(z) == 0 or np.linalg.norm(x) < 1e-9 * np.linalg.norm(z):
        raise InputError("the direction of view must not be zero or parallel to 'up'", key="look_at", found=list(goal))
    z, x = z / np.linalg.norm(z), x / np.linalg.norm(x)
    return transform(np.column_stack([x, np.cross(z, x), z]), np.asarray(eye, dtype=np.float64))
