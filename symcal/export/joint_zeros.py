"""Zeros of joints with which an arm acts most like another one: least squares over postures, 1 rad like `LEVER` mm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal.compensation.compensate import LEVER
from symcal.compensation.targets import base_frames
from symcal.kernels.batch import batch_function
from symcal.kinematics import chain, forward
from symcal.parameters import SCALE, ParameterSet
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

WEIGHTS = np.array([1.0] * 3 + [LEVER] * 3)
"""Of a difference of two poses, mm and rad."""


def slopes_of_zeros(robot: Robot, q: Array) -> tuple[Array, Array]:
    """T_base_tool, shape (n, 4, 4), and its weighted slopes by the joints' zeros, (n, 6, dof), at readings (n, dof)."""
    kernel = batch_function(forward(chain(robot, ParameterSet(()))), evaluations=len(q))
    poses, slopes = kernel(q, np.zeros(0), np.asarray(base_frames(robot)).ravel())[:2]
    rates = np.array([joint.sign * joint.ratio for joint in robot.joints])
    return np.asarray(poses), np.asarray(slopes / rates * WEIGHTS[:, None])


def least_zeros(robot: Robot, slopes: Array, wanted: Array) -> Array:
    """Shifts of the zeros, rad or mm, shape (dof,), that move the tool as wanted, weighted, shape (n, 6); the smallest
    where several do."""
    sizes = np.array([SCALE["rad" if joint.revolute else "mm"] for joint in robot.joints])
    rows = (slopes * sizes).reshape(-1, robot.dof)
    return np.asarray(np.linalg.lstsq(rows, wanted.ravel(), rcond=1e-10)[0] * sizes)


def shifted(robot: Robot, shifts: Sequence[float] | Array) -> Robot:
    """The robot with shifts, rad or mm, added to the zeros of its joints."""
    links = tuple(
        replace(link, joint=replace(link.joint, offset=link.joint.offset + float(shift)))
        for link, shift in zip(robot.links, shifts, strict=True)
    )
    return replace(robot, links=links)
