"""Where a tool is to be: from joints commanded for the nominal robot, or from positions and poses; arrays or CSV."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.documents.csv_file import read_table
from symcal.documents.table import Table, joint_readings
from symcal.errors import InputError, RefusedError
from symcal.kernels.batch import batch_function
from symcal.kinematics import Chain, chain, frame_vector, function
from symcal.parameters import ParameterSet
from symcal.robot.robot import Robot
from symcal.units import ANGLE, LENGTH

Array = NDArray[np.float64]
Frame = Literal["base", "world"]

POSE_JOINTS = 6
"""A tool has six freedoms: with fewer joints its orientation follows from its position."""

_UNIT_ERROR = 1e-3  # how far from 1 the length of a written quaternion may be
_OUTSIDE = 1e-9  # rad or mm beyond a limit that conversion between units can make


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """N poses wanted of the tool in the base frame.

    poses: T_base_tool, shape (N, 4, 4), mm; the rotation is the identity where ``oriented`` is False and means nothing.
    joints: readings with which the nominal robot is there, or near; shape (N, dof), or None.
    """

    poses: Array
    oriented: bool
    joints: Array | None = None

    def __len__(self) -> int:
        return len(self.poses)


def base_chain(robot: Robot) -> Chain:
    """The robot's kinematics with its present numbers; its ``frames`` are to be replaced by `base_frames`."""
    return chain(robot, ParameterSet(()))


def base_frames(robot: Robot) -> ca.DM:
    """The value of ``Chain.frames`` with which poses are in the base frame, wherever the instrument saw the base."""
    return ca.DM(frame_vector(np.eye(4), robot.tool))


def tool_pose(robot: Robot) -> ca.Function:
    """q -> T_base_tool, shape (4, 4)."""
    model = base_chain(robot)
    return function("tool_pose", {"q": model.q}, {"pose": ca.substitute(model.tool, model.frames, base_frames(robot))})


def tool_poses(robot: Robot, joints: Array) -> Array:
    """T_base_tool of a few readings, shape (n, dof) -> (n, 4, 4), mm; nothing is compiled for them."""
    pose = tool_pose(robot)
    return np.array([np.asarray(pose(q)) for q in joints])


def commanded(robot: Robot, joints: Array) -> Targets:
    """The poses to which joints commanded for the nominal robot were meant to bring the tool.

    Args:
        robot: calibrated; its nominal numbers are those that the command was computed with.
        joints: readings, shape (N, dof), rad and mm.
    Raises:
        InputError: wrong shape, a number that is not finite, or a reading outside the joint's limits.

    Example:
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/ur5.yaml")
        >>> len(sc.commanded(robot, [[0.1, -1.2, 1.0, -1.5, -1.5, 0.0]]))
        1
    """
    joints = _checked(robot, joints)
    (poses,) = batch_function(tool_pose(robot.nominal()), evaluations=len(joints))(joints)
    return Targets(poses, oriented=True, joints=joints)


def wanted(robot: Robot, targets: Array, *, joints: Array | None = None, frame: Frame = "base") -> Targets:
    """Positions (N, 3) or poses (N, 4, 4) wanted of the tool, mm.

    Args:
        joints: readings from which the search for the nominal robot's joints starts, shape (N, dof).
        frame: of the targets; ``world`` is the instrument's, known through the calibrated base frame.
    Raises:
        InputError: wrong shapes or numbers that are not finite.
        RefusedError: poses for an arm with fewer than six joints.

    Example:
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/ur5.yaml")
        >>> targets = sc.wanted(robot, [[400.0, -200.0, 300.0]])
        >>> len(targets), targets.oriented
        (1, False)
    """
    targets = np.asarray(targets, dtype=np.float64)
    if targets.ndim < 2 or targets.shape[1:] not in ((3,), (4, 4)) or not np.isfinite(targets).all():
        message = "targets are finite positions of shape (N, 3) or poses of shape (N, 4, 4)"
        raise InputError(message, found=targets.shape)
    oriented = targets.ndim == 3
    if oriented and robot.dof < POSE_JOINTS:
        raise RefusedError(
            f"{robot.name} has {robot.dof} joints: an arm with fewer than six cannot take every orientation at a "
            "position; give positions alone"
        )
    poses = targets
    if not oriented:
        poses = np.tile(np.eye(4), (len(targets), 1, 1))
        poses[:, :3, 3] = targets
    if frame == "world":
        poses = spatial.inverse(robot.base) @ poses
    return Targets(poses, oriented, None if joints is None else _checked(robot, joints, len(targets)))


def _checked(robot: Robot, joints: Array, count: int | None = None) -> Array:
    """Readings of shape (N, dof) within the limits."""
    joints = np.asarray(joints, dtype=np.float64)
    if joints.ndim != 2 or joints.shape[1] != robot.dof or count not in (None, len(joints)):
        wanted_shape = f"({'N' if count is None else count}, {robot.dof})"
        raise InputError(f"joints have shape {wanted_shape}", found=joints.shape)
    outside = ~((joints >= robot.lower - _OUTSIDE) & (joints <= robot.upper + _OUTSIDE) & np.isfinite(joints))
    if outside.any():
        row, i = np.argwhere(outside)[0]
        raise InputError(f"row {row + 1}: {_limits(robot, int(i))}", found=_reading(robot, int(i), joints[row, i]))
    return np.clip(joints, robot.lower, robot.upper)


def _limits(robot: Robot, i: int) -> str:
    joint = robot.joints[i]
    low, high = (_reading(robot, i, value) for value in (joint.lower, joint.upper))
    return f"the reading of joint '{joint.name}' is outside its limits, {low} to {high}"


def _reading(robot: Robot, i: int, value: float) -> str:
    return f"{np.degrees(value):g} deg" if robot.joints[i].revolute else f"{value:g} mm"


# ------------------------------------------------------------------------------------------------------------ CSV files


def read_targets(path: Path | str, robot: Robot, frame: Frame = "base") -> Targets:
    """Read targets: joints commanded for the nominal robot, or positions or poses with or without joints to start from.

    Columns: `q1_deg,q2_mm,...` (or the joints' names), and `x_mm,y_mm,z_mm` with `qx,qy,qz,qw` or
    `roll_deg,pitch_deg,yaw_deg` where the orientation matters; any length or angle unit.

    Raises:
        InputError: a column is missing or has no unit, or a row cannot be read or is outside the limits (with its
            line).
        RefusedError: orientations for an arm with fewer than six joints.
    """
    table = read_table(path)
    if not len(table):
        raise InputError("the file has a header but no rows", file=path)
    stems = table.stems()
    named = {joint.name for joint in robot.joints} | {f"q{i}" for i in range(1, robot.dof + 1)}
    joints = None
    if any(stem in named for stem in stems):
        joints = joint_readings(table, [(joint.name, joint.revolute) for joint in robot.joints])
        outside = np.argwhere((joints < robot.lower - _OUTSIDE) | (joints > robot.upper + _OUTSIDE))
        if len(outside):
            row, i = map(int, outside[0])
            more = len({int(k) for k, _ in outside}) - 1
            tail = f" ({more} more rows are outside theirs)" if more else ""
            found = _reading(robot, i, joints[row, i])
            raise InputError(f"{_limits(robot, i)}{tail}", file=path, line=table.lines[row], found=found)
    if not any(c in stems for c in "xyz"):
        if joints is None:
            message = "there are no targets: expected columns for joints (q1_deg, ...) or a position (x_mm, y_mm, z_mm)"
            raise InputError(message, file=path, line=1)
        return commanded(robot, joints)
    xyz = np.column_stack([table.quantity(c, LENGTH, f"the target's {c}") for c in "xyz"])
    rotations = _rotations(table)
    if rotations is None:
        return wanted(robot, xyz, joints=joints, frame=frame)
    poses = np.tile(np.eye(4), (len(xyz), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rotations, xyz
    return wanted(robot, poses, joints=joints, frame=frame)


def _rotations(table: Table) -> Array | None:
    """Rotation matrices (N, 3, 3) of the quaternion or roll-pitch-yaw columns; None when there are neither."""
    stems = table.stems()
    if any(c in stems for c in ("qx", "qy", "qz", "qw")):
        for c in ("qx", "qy", "qz", "qw"):
            if c not in table.columns:
                raise InputError("a quaternion column is missing", file=table.path, line=1, key=c)
        quaternion = np.column_stack([table.numbers(c) for c in ("qx", "qy", "qz", "qw")])
        norms = np.linalg.norm(quaternion, axis=1)
        for row in np.flatnonzero(np.abs(norms - 1) > _UNIT_ERROR):
            message = "the quaternion is not of unit length"
            raise InputError(message, file=table.path, line=table.lines[row], found=f"{norms[row]:.6g}")
        return spatial.quaternion_matrices(quaternion)
    if any(c in stems for c in ("roll", "pitch", "yaw")):
        angles = [table.quantity(c, ANGLE, f"the target's {c}") for c in ("roll", "pitch", "yaw")]
        return spatial.rpy_matrix(np.column_stack(angles))
    return None


def joint_columns(robot: Robot, joints: Array) -> dict[str, Array]:
    """Readings (N, dof) in rad and mm as columns `q1_deg`, `q2_mm`, ..."""
    return {
        f"q{i + 1}_{'deg' if joint.revolute else 'mm'}": np.degrees(joints[:, i]) if joint.revolute else joints[:, i]
        for i, joint in enumerate(robot.joints)
    }
