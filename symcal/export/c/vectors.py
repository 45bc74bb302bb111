"""Test vectors from kinematics written a second time: products of 4 x 4 matrices of numbers, nothing symbolic.

This is the oracle of the exported self-test, which must not inherit a mistake of the expressions that it checks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from symcal.compensation.compensate import LEVER, joint_caps
from symcal.export.c.terms import Posture, added
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

_SAFE = 0.8  # share of a cap that an expected correction uses at most
_STIFF = 0.5  # least singular value, in mm per mm, for the damping to cost nothing after three steps


@dataclass(frozen=True, slots=True, eq=False)
class Vectors:
    """K readings and what is expected there; all in the base frame, mm and rad.

    q: shape (K, dof), exact in single precision, off the limits. nominal, calibrated: poses, shape (K, 4, 4).
    jacobian: of the calibrated robot, shape (K, 6, dof). reached, reached_pose: whether compensation must get there,
    shape (K,): the exact solution is well inside limits and caps.
    """

    q: Array
    nominal: Array
    calibrated: Array
    jacobian: Array
    reached: NDArray[np.bool_]
    reached_pose: NDArray[np.bool_]


def self_test_vectors(robot: Robot, count: int) -> Vectors:
    """Readings spread over the joints' ranges by a fixed sequence, and what is expected there."""
    nominal = robot.nominal()
    q = readings(robot, count)
    targets = np.array([pose(nominal, row) for row in q])
    return Vectors(
        q=q,
        nominal=targets,
        calibrated=np.array([pose(robot, row) for row in q]),
        jacobian=np.array([jacobian(robot, row) for row in q]),
        reached=np.array([_reachable(robot, row, t, False) for row, t in zip(q, targets, strict=True)]),
        reached_pose=np.array([_reachable(robot, row, t, True) for row, t in zip(q, targets, strict=True)]),
    )


def readings(robot: Robot, count: int) -> Array:
    """Readings, shape (count, dof), inside the limits by more than the caps where the range allows; float32-exact.

    An additive recurrence with the powers of the generalised golden ratio, which fills the range evenly.
    """
    ratio = 2.0
    for _ in range(60):
        ratio = (1 + ratio) ** (1 / (robot.dof + 1))
    fraction = (0.5 + np.outer(np.arange(1, count + 1), ratio ** -np.arange(1.0, robot.dof + 1))) % 1.0
    span = np.array([(np.pi if j.revolute else max(robot.reach, 100.0)) / abs(j.ratio) for j in robot.joints])
    lower = np.where(np.isfinite(robot.lower), robot.lower, -span)
    upper = np.where(np.isfinite(robot.upper), robot.upper, span)
    margin = np.minimum(1.5 * joint_caps(robot), 0.1 * (upper - lower))
    q: Array = lower + margin + fraction * (upper - lower - 2 * margin)
    return q.astype(np.float32).astype(np.float64)


def pose(robot: Robot, q: Array) -> Array:
    """T_base_tool, shape (4, 4)."""
    return np.asarray(_frames(robot, q, _terms(robot, q)[0])[1] @ robot.tool)


def jacobian(robot: Robot, q: Array) -> Array:
    """Velocity of the tool's origin (mm) over angular velocity (rad) per unit of each reading, base frame; (6, dof)."""
    delta, slopes = _terms(robot, q)
    joints, flange = _frames(robot, q, delta)
    tip = (flange @ robot.tool)[:3, 3]
    by_joint = np.zeros((6, robot.dof))
    for i, (joint, frame) in enumerate(zip(robot.joints, joints, strict=True)):
        axis = frame[:3, 2]
        by_joint[:3, i] = np.cross(axis, tip - frame[:3, 3]) if joint.revolute else axis
        by_joint[3:, i] = axis if joint.revolute else 0.0
    return by_joint @ (np.diag(_rates(robot)) + slopes)


def _rates(robot: Robot) -> Array:
    return np.array([joint.sign * joint.ratio for joint in robot.joints])


def _terms(robot: Robot, q: Array) -> tuple[Array, Array]:
    """What joint terms add to the joints, shape (dof,), and the slopes of that by readings, shape (dof, dof)."""
    if not robot.terms:
        return np.zeros(robot.dof), np.zeros((robot.dof, robot.dof))
    joints, flange = _frames(robot, q, np.zeros(robot.dof))
    return added(Posture(robot, q, [*joints, flange], _rates(robot)))


def _frames(robot: Robot, q: Array, delta: Array) -> tuple[list[Array], Array]:
    """Frames of the joints behind their own motion, and of the flange, in base; shape (4, 4) each."""
    joints, t = [], np.eye(4)
    for link, reading, more in zip(robot.links, q, delta, strict=True):
        theta, alpha, a, d, beta = (link.parameters.get(kind, 0.0) for kind in ("theta", "alpha", "a", "d", "beta"))
        motion = link.joint.sign * link.joint.ratio * float(reading) + link.joint.offset + more
        theta, d = (theta + motion, d) if link.joint.revolute else (theta, d + motion)
        screw = _transform(Rotation.from_euler("Z", theta), (0.0, 0.0, d))
        if robot.convention == "standard":
            joints.append(t @ screw)
            t = joints[-1] @ _transform(Rotation.from_euler("XY", [alpha, beta]), (a, 0.0, 0.0))
        else:
            t = t @ _transform(Rotation.from_euler("XY", [alpha, beta]), (a, 0.0, 0.0)) @ screw
            joints.append(t)
    return joints, t


def _transform(rotation: Rotation, origin: tuple[float, float, float]) -> Array:
    t = np.eye(4)
    t[:3, :3], t[:3, 3] = rotation.as_matrix(), origin
    return t


def _reachable(robot: Robot, start: Array, target: Array, oriented: bool) -> bool:
    """Whether plain Newton, unaware of limits, gets to the target and stays clear of limits, caps and singularities."""
    weight = np.array([1 / LEVER if j.revolute else 1.0 for j in robot.joints]) / [abs(j.ratio) for j in robot.joints]
    rows = np.array([1.0] * 3 + [LEVER] * 3)[: 6 if oriented else 3]
    caps = joint_caps(robot)
    q = start.copy()
    for _ in range(8):
        present = pose(robot, q)
        turn = Rotation.from_matrix(target[:3, :3] @ present[:3, :3].T).as_rotvec()
        error = rows * np.concatenate([target[:3, 3] - present[:3, 3], turn])[: len(rows)]
        scaled = rows[:, None] * jacobian(robot, q)[: len(rows)] * weight
        if len(rows) > robot.dof or np.linalg.svd(scaled, compute_uv=False)[-1] < _STIFF:
            return False
        q = q + weight * np.linalg.lstsq(scaled, error, rcond=None)[0]
        if (np.abs(q - start) > _SAFE * caps).any() or (q <= robot.lower).any() or (q >= robot.upper).any():
            return False
    return bool(np.linalg.norm(error) < 1e-9 * max(robot.reach, 1.0))
