"""How far a correction may move a joint."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from symcal.kinematics import motions
from symcal.parameters import zero_name
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

CAPS = (0.02, 10.0)
"""The largest correction of a joint: rad, mm. More is an error, not a correction, unless zero offsets are larger."""
OFFSETS = 3.0
"""How much larger than the largest zero offset of the arm a correction may be: joints also make up for each other."""
WIDEST = 5.0
"""How much wider than its default a cap may become: larger offsets are refused as absurd elsewhere."""

_POSTURES = 500


def joint_caps(robot: Robot, caps: tuple[float, float] = CAPS) -> Array:
    """The largest correction of every reading, shape (dof,), rad or mm.

    ``caps`` (rad, mm) are of the joint, behind its ratio. Where the calibration found zero offsets nearly as large, or
    joint terms that move a joint as far, they are what is to be corrected and no accident: the cap is then OFFSETS
    times the largest of the arm, and at most WIDEST times the default.
    """
    errors = {} if robot.record is None else robot.record.errors
    largest, moved = [caps[0], caps[1]], np.zeros(robot.dof)
    if any(errors.get(name) for name in robot.term_parameters):
        q = np.random.default_rng(0).uniform(*robot.ranges, (_POSTURES, robot.dof))
        moved = np.abs(moved_by_terms(robot, errors, q)).max(axis=0)
    for i, joint in enumerate(robot.joints, start=1):
        kind = 0 if joint.revolute else 1
        offset = abs(errors.get(zero_name(not kind, i), 0.0)) + moved[i - 1]
        largest[kind] = max(largest[kind], min(OFFSETS * offset, WIDEST * caps[kind]))
    return np.array([(largest[0] if j.revolute else largest[1]) / abs(j.ratio) for j in robot.joints])


def moved_by_terms(robot: Robot, values: Mapping[str, float], q: Array) -> Array:
    """By how much joint terms with these numbers, by parameter name, move each joint at readings (N, dof), nominal
    conditions; shape (N, dof), rad or mm."""
    moved = np.zeros(q.shape)
    for term, own in zip(robot.terms, motions(robot, q), strict=True):
        moved[:, term.joint - 1] += own @ [values.get(p.name, 0.0) for p in term.parameters]
    return moved
