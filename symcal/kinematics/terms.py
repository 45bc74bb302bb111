"""What joint terms add to the coordinates of a chain, and how that changes with readings and parameters."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.joints.arm import Arm
from symcal.kernels import batch_function
from symcal.kinematics.functions import function
from symcal.kinematics.walk import Moves, Walk, reading_name, walk_link
from symcal.robot.robot import Robot

SX = ca.SX
Array = NDArray[np.float64]


def moves_of(robot: Robot, q: SX, x: SX, error: dict[str, SX], conditions: SX) -> Moves:
    """delta(q, x) of the robot's joint terms and its derivatives."""
    if not robot.terms:
        return Moves({}, {})
    arm, delta = arm_of(robot, q, error, conditions), dict[int, SX]()
    for term in robot.terms:
        basis = term.basis(arm)
        values = {p.name: p.value + error.get(p.name, 0) for p in term.parameters}
        own = sum((values[term.name(label)] * slope for label, slope in basis.items()), SX(0))
        delta[term.joint] = delta.get(term.joint, SX(0)) + own
    slopes: dict[str, list[tuple[int, SX]]] = {}
    for i, moved in sorted(delta.items()):
        for names, by in (([reading_name(j) for j in range(1, robot.dof + 1)], q), (list(error), x)):
            gradient = ca.jacobian(moved, by)
            for column, name in enumerate(names):
                slope = gradient[0, column]
                if not slope.is_zero():
                    slopes.setdefault(name, []).append((i, slope))
    return Moves(delta, slopes)


def bases(robot: Robot) -> ca.Function:
    """q -> what the numbers of joint terms move their joints by, per unit, at nominal conditions; shape (numbers,).

    In the order of `Robot.term_parameters`; rad or mm per unit.
    """
    q = SX.sym("q", robot.dof)
    arm = arm_of(robot, q, {}, SX(0, 1))
    found = [slope for term in robot.terms for slope in term.basis(arm).values()]
    return function("bases", {"q": q}, {"b": ca.vertcat(*found)})


def motions(robot: Robot, q: Array) -> tuple[Array, ...]:
    """`bases` at readings (N, dof), term by term: shape (N, numbers of the term) each."""
    (found,) = batch_function(bases(robot), evaluations=0)(q)
    ends = np.cumsum([len(term.numbers) for term in robot.terms])
    return tuple(np.split(found.reshape(len(q), -1), ends[:-1], axis=1))


def arm_of(robot: Robot, q: SX, error: dict[str, SX], conditions: SX) -> Arm:
    """What joint terms may ask; where the links are only if one of them does."""
    joints = robot.joints
    moved = ca.vertcat(*(joint.sign * joint.ratio * q[i] for i, joint in enumerate(joints)))
    frames: list[tuple[SX, SX]] = []
    if any(term.needs_arm for term in robot.terms):
        walk = Walk(SX.eye(3), SX(3, 1))
        for i, link in enumerate(robot.links, start=1):
            frames.append(walk_link(walk, robot.convention, i, link, q[i - 1], error, None))
        frames.append((walk.rotation, walk.origin))
    return Arm(
        q=q,
        moved=moved,
        revolute=tuple(joint.revolute for joint in joints),
        frames=tuple(frames),
        down=robot.down,
        conditions={n: conditions[k] if k < conditions.numel() else SX(0) for k, n in enumerate(robot.conditions)},
        masses=robot.masses,
        payload=robot.payload,
    )
