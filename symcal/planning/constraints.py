"""What a pose must satisfy to be measured: named conditions, joint limits, and the words for what breaks them.

A constraint's violation is a signed amount per pose: at most 0 where it holds, else by how much it is broken.
`visibility` and `clearance` have the ones of the camera and of the surroundings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
PoseFunction = Callable[[Array], Array]
"""(N, dof) -> (N,): a number per pose."""

ROUNDING = 1e-9
"""Violations up to this (mm, rad, px) are rounding: a pose may sit on its limit."""


@dataclass(frozen=True, slots=True)
class Constraint:
    """One condition on a pose.

    name: what must hold, in words. unit: of the violation. violation: (N, dof) -> (N,), at most 0 where it holds.
    scale: a violation that counts as one when violations of different kinds are added up (`plan_violation`).
    """

    name: str
    unit: Literal["mm", "rad", "px", "1"]
    violation: PoseFunction
    scale: float = 1.0

    def amount(self, value: float) -> str:
        """A violation in words."""
        if self.unit == "rad":
            return f"{np.rad2deg(value):.3g} deg"
        return f"{value:.3g}" + ("" if self.unit == "1" else f" {self.unit}")


def joint_limits(robot: Robot, *, angle_margin: float = 0.0, length_margin: float = 0.0) -> tuple[Constraint, ...]:
    """One constraint per joint that has a limit; margins in rad (revolute) and mm (prismatic) are kept on both
    sides."""
    made = []
    for i, joint in enumerate(robot.joints):
        if not (np.isfinite(joint.lower) or np.isfinite(joint.upper)):
            continue
        margin = angle_margin if joint.revolute else length_margin
        made.append(
            Constraint(
                f"joint {i + 1} '{joint.name}' within its limits",
                "rad" if joint.revolute else "mm",
                _Range(i, joint.lower + margin, joint.upper - margin),
                scale=0.1 if joint.revolute else 10.0,
            )
        )
    return tuple(made)


@dataclass(frozen=True, slots=True)
class _Range:
    """How far joint i is outside [lower, upper]; a class and not a closure, so that it can go to another process."""

    i: int
    lower: float
    upper: float

    def __call__(self, poses: Array) -> Array:
        return np.maximum(self.lower - poses[:, self.i], poses[:, self.i] - self.upper)


@dataclass(frozen=True, slots=True)
class Satisfied:
    """(N, dof) -> (N,): which poses satisfy all constraints, up to rounding.

    Later constraints are evaluated only where earlier ones hold: put cheap ones first.
    """

    constraints: tuple[Constraint, ...]

    def __call__(self, poses: Array) -> Mask:
        alive = np.arange(len(poses))
        for constraint in self.constraints:
            if not alive.size:
                break
            alive = alive[constraint.violation(poses[alive]) <= ROUNDING]
        out = np.zeros(len(poses), dtype=np.bool_)
        out[alive] = True
        return out

    def violations(self, poses: Array) -> Array:
        """Of each constraint in multiples of its scale, shape (N, constraints)."""
        return np.stack([each.violation(poses) / each.scale for each in self.constraints], axis=1)


def feasible(constraints: Sequence[Constraint]) -> Satisfied:
    """Which poses satisfy all of some constraints."""
    return Satisfied(tuple(constraints))


def complaints(constraints: Sequence[Constraint], poses: Array, labels: Sequence[str] | None = None) -> tuple[str, ...]:
    """A sentence for each pose that breaks constraints: which, and by how much.

    Args:
        poses: shape (N, dof). labels: their names; `pose 1`, `pose 2`, ... when None.
    """
    names = labels if labels is not None else [f"pose {i + 1}" for i in range(len(poses))]
    broken: list[list[str]] = [[] for _ in names]
    for constraint in constraints:
        values = constraint.violation(poses)
        for i in np.flatnonzero(~(values <= ROUNDING)):
            broken[i].append(f"'{constraint.name}' by {constraint.amount(float(values[i]))}")
    return tuple(f"{name} breaks {', '.join(items)}" for name, items in zip(names, broken, strict=True) if items)


def insist(constraints: Sequence[Constraint], poses: Array, labels: Sequence[str] | None = None) -> Array:
    """The poses that the user insists on, once they are known to be feasible.

    Raises:
        RefusedError: naming every pose that is not, what it breaks and by how much.
    """
    poses = np.asarray(poses, dtype=np.float64)
    sentences = complaints(constraints, poses, labels)
    if sentences:
        count = f"{len(sentences)} of the {len(poses)} poses that the plan must contain"
        raise RefusedError(f"{count} cannot be measured: {'; '.join(sentences)}. Change them, or the constraints.")
    return poses


def plan_violation(constraints: Sequence[Constraint]) -> Callable[[Array], Array]:
    """(P, N, dof) -> (P,): what all poses of a plan violate, in multiples of the constraints' scales; 0 if nothing.

    Ours: a search that compares infeasible plans needs one number, and it must fall as poses are mended.
    """

    def total(plans: Array) -> Array:
        poses = plans.reshape(-1, plans.shape[-1])
        amount = np.zeros(len(poses))
        for constraint in constraints:
            value = np.nan_to_num(constraint.violation(poses), nan=1e9, posinf=1e9)
            amount += np.where(value > ROUNDING, value / constraint.scale, 0.0)
        return np.asarray(amount.reshape(plans.shape[:2]).sum(axis=1))

    return total


def with_fixed(function: Callable[[Array], Array], fixed: Array) -> Callable[[Array], Array]:
    """A function of plans as one of the free poses alone: ``fixed``, shape (K, dof), come first in every plan."""

    def complete(plans: Array) -> Array:
        shared = np.broadcast_to(fixed, (len(plans), *fixed.shape))
        return function(np.concatenate([shared, plans], axis=1))

    return complete
