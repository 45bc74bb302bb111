"""A robot whose flange pose is data: three prismatic and three revolute joints whose readings follow from each pose.

Pairs of poses, of a flange and of what was measured there, hold no joint readings. With this robot they are
measurements like others, of which only frames are estimated: its links are exact by construction.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.documents.table import Table
from symcal.robot.robot import Robot
from symcal.units import ANGLE, LENGTH
from symcal.words import GIVEN

Array = NDArray[np.float64]

GIVEN_FILE = Path(__file__).with_name(f"{GIVEN}.yaml")
NO_JOINTS = "pairs of poses hold no joint readings: hand-eye and other frames only, no kinematics"

_ANGLES = ("flange_roll", "flange_pitch", "flange_yaw")
_QUATERNION = ("flange_qx", "flange_qy", "flange_qz", "flange_qw")
STEMS = ("flange_x", "flange_y", "flange_z", *_QUATERNION, *_ANGLES)
"""Columns of the flange's pose in the base frame."""


def is_given(robot: Robot) -> bool:
    """Whether this is the robot whose poses are data."""
    return robot.name == GIVEN


def given_readings(poses: Array) -> Array:
    """Joint readings, shape (N, 6), mm and rad, that put the flange at poses (N, 4, 4)."""
    r, p = poses[:, :3, :3], poses[:, :3, 3]
    level = np.hypot(r[:, 0, 0], r[:, 0, 1])
    turned = level > 1e-9  # else only a sum of the first and the last angle counts
    first = np.where(turned, np.arctan2(-r[:, 1, 2], r[:, 2, 2]), np.arctan2(r[:, 2, 1], r[:, 1, 1]))
    last = np.where(turned, np.arctan2(-r[:, 0, 1], r[:, 0, 0]), 0.0)
    return np.column_stack([p[:, 2], p[:, 1], p[:, 0], first, np.arctan2(r[:, 0, 2], level), last])


def with_given_readings(table: Table) -> Table:
    """A table with columns of the flange's pose as one with the joint readings of the robot.

    Raises:
        InputError: a column of the pose is missing or has no unit, or a quaternion is not of unit length.
    """
    xyz = np.column_stack([table.quantity(f"flange_{c}", LENGTH, f"{c} of the flange") for c in "xyz"])
    if any(stem in table.columns for stem in _QUATERNION):
        for stem in _QUATERNION:
            if stem not in table.columns:
                message = "a quaternion column of the flange is missing"
                raise table.error(message, column=stem, allowed=table.columns)
        quaternion = np.column_stack([table.numbers(stem) for stem in _QUATERNION])
        norm = np.linalg.norm(quaternion, axis=1)
        for row in np.flatnonzero(np.abs(norm - 1) > 1e-3):
            raise table.error("the flange's quaternion is not of unit length", row=row, found=f"{norm[row]:.6g}")
        rotation = spatial.quaternion_matrices(quaternion)
    else:
        angles = [table.quantity(stem, ANGLE, f"{stem} (or flange_qx.. flange_qw)") for stem in _ANGLES]
        rotation = spatial.rpy_matrix(np.column_stack(angles))
    poses = np.zeros((len(xyz), 4, 4))
    poses[:, :3, :3], poses[:, :3, 3], poses[:, 3, 3] = rotation, xyz, 1.0
    for i, column in enumerate(given_readings(poses).T.tolist(), start=1):
        table = table.with_column(f"q{i}_{'mm' if i < 4 else 'rad'}", "\n".join(map(repr, column)))
    return table
