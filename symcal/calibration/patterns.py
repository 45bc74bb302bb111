"""What residuals are tested for: motions of the joints that the robot's model lacks, and drift."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.candidates import gravity_terms
from symcal.data.conditions import directions_from_order
from symcal.data.dataset import Dataset
from symcal.fit.pose_rows import PoseRows
from symcal.joints import Term
from symcal.joints.backlash import Backlash, direction_name
from symcal.joints.harmonics import Harmonics
from symcal.joints.ratio import Ratio
from symcal.kinematics import motions
from symcal.parameters import zero_name
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
Kind = Literal["angle", "harmonic", "gravity", "approach", "drift", "neighbours", "reach"]

WAVES = (1, 2, 3, 4)
"""Multiples of a joint's reading whose waves are looked for."""


@dataclass(frozen=True, slots=True)
class Pattern:
    """Columns that residuals are tested for.

    joint: from one; 0 of what belongs to none. k: the multiple of a wave. name: in words. motion: what the joint moves
    by per unit of each, shape (N, d), rad or mm; None of what is no joint's. columns: whitened rows, shape (k, d).
    stated: of a direction, whether the data have it rather than their order.
    """

    kind: Kind
    name: str
    columns: Array
    joint: int = 0
    k: int = 0
    motion: Array | None = None
    unit: str = ""
    stated: bool = False


def joint_rows(robot: Robot, names: tuple[str, ...], rows: PoseRows) -> Array:
    """Rows by the coordinate of every joint, rad or mm, shape (k, dof): those of its zero; zero where it has none.

    A term of joint i moves the joint as its zero does, by its basis: its column is this one times the basis.

    Args:
        names: of all parameters.
    """
    out = np.zeros((len(rows.r), robot.dof))
    for i, joint in enumerate(robot.joints):
        name = zero_name(joint.revolute, i + 1)
        if name in names:
            out[:, i] = rows.jacobian[:, names.index(name)]
    return out


def joint_patterns(robot: Robot, data: Dataset, order: Dataset, rows: PoseRows, joints: Array) -> list[Pattern]:
    """Every joint's angle, waves, gravity and direction of approach, of what the robot's terms do not have.

    Args:
        data: the training poses. order: all poses in the order of the file, of which ``data`` are those of the split.
        joints: from `joint_rows`.
    """
    every = list(enumerate((j.revolute for j in robot.joints), start=1))
    terms: list[tuple[Kind, Term]] = [("angle", Ratio(i, turns)) for i, turns in every]
    terms += [("harmonic", Harmonics(i, True, k=(k,))) for i, turns in every if turns for k in WAVES]
    terms += [("gravity", term) for term in gravity_terms(robot)]
    own = robot.term_parameters
    terms = [(kind, term) for kind, term in terms if not any(p.name in own for p in term.parameters)]
    wanted = replace(robot, terms=tuple(term for _, term in terms))
    found = []
    for (kind, term), motion in zip(terms, motions(wanted, data.q), strict=True):
        k = term.k[0] if isinstance(term, Harmonics) else 0
        found.append(_of_joint(kind, term.joint, robot, rows, joints, motion, k))
    came = directions_from_order(order, robot).conditions
    training = [split == "train" for split in order.split]
    for i, turns in every:
        if not any(p.name in own for p in Backlash(i, turns).parameters):
            stated = direction_name(i) in data.conditions
            motion = came[direction_name(i)][training]
            each = _of_joint("approach", i, robot, rows, joints, -motion[:, None])
            found.append(replace(each, stated=stated))
    return [pattern for pattern in found if pattern.columns.any()]


def _of_joint(
    kind: Kind, joint: int, robot: Robot, rows: PoseRows, joints: Array, motion: Array, k: int = 0
) -> Pattern:
    name = {
        "angle": f"the {'angle' if robot.joints[joint - 1].revolute else 'stroke'} of joint {joint}",
        "harmonic": f"a wave of joint {joint}, {k} to a turn",
        "gravity": f"gravity at joint {joint}",
        "approach": f"the direction from which joint {joint} came",
    }[kind]
    columns = joints[:, joint - 1 : joint] * motion[rows.pose]
    unit = "rad" if robot.joints[joint - 1].revolute else "mm"
    return Pattern(kind, name, columns, joint, k, motion, unit)


def drifts(rows: PoseRows, order: Dataset) -> list[Pattern]:
    """A linear drift of what every noise group reads, from the first pose of the file to the last."""
    at = np.flatnonzero([split == "train" for split in order.split])
    run = max(float(np.ptp(at)), 1.0)
    share = (at - at.mean()) / run
    return [
        Pattern("drift", f"the order of the measurements ({m.what})", m.columns * share[rows.pose, None], unit=m.unit)
        for m in rows.displacements
    ]
