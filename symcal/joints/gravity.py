r"""A joint that yields to gravity, without known masses:  delta_i = sum_k w_k (lever of a unit weight at k) / 300 mm.

The weights stand at points that the joint carries: `x` and `y` of its own frame (300 mm from the axis), origins of
later joints (`q4`), the flange. What the arm weighs and how stiff it is are lumped together: w_k is the deflection by
weight k on a horizontal arm of 300 mm. The basis is ours; its shape is that of the base parameters of gravity in
[Khalil2002].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from symcal.joints.arm import Arm
from symcal.joints.term import Number, Term
from symcal.parameters import Unit
from symcal.words import in_short, listed

LEVER = 300.0
"""mm: the arm that a deflection by gravity is stated for."""

OWN: dict[str, tuple[float, float, float]] = {"x": (LEVER, 0.0, 0.0), "y": (0.0, LEVER, 0.0)}
"""Points of a joint's own frame, mm."""

FLANGE = "flange"

_SIZES: dict[bool, float] = {True: 3e-3, False: 0.1}
"""Plausible deflection, rad of a revolute joint and mm of a prismatic one."""


def later(joint: int) -> str:
    """What the origin of a later joint is called."""
    return f"q{joint}"


def points_of(joint: int, revolute: bool, dof: int) -> tuple[str, ...]:
    """Where the weights of a joint may stand; along a prismatic one they all weigh the same."""
    return (*(OWN if revolute else ("x",)), *(later(j) for j in range(joint + 1, dof + 1)), FLANGE)


@dataclass(frozen=True)
class Gravity(Term):
    """points: where the weights are: `x`, `y`, `q<joint>`, `flange`."""

    kind: ClassVar[str] = "gravity"
    definition: ClassVar[str] = (
        "sum over points of gravity_<point> * L_i(p) / 300 mm, of a prismatic joint of gravity_<point> * L_i; points x "
        "and y are at 300 mm on these axes of the frame of joint i, q<j> is the origin of the frame of joint j, flange "
        "that of the flange"
    )
    keys: ClassVar[tuple[str, ...]] = ("points",)

    points: tuple[str, ...] = ("x", "y")

    @property
    def numbers(self) -> tuple[Number, ...]:
        unit: Unit = "rad" if self.revolute else "mm"
        return tuple(Number(f"gravity_{point}", unit, _SIZES[self.revolute], "gravity") for point in self.points)

    @property
    def needs_arm(self) -> bool:
        return True

    @property
    def said(self) -> str:
        return f"the gravity moment of weights at {in_short(self.points)}" if self.revolute else "gravity along it"

    def words(self, joints: Sequence[str]) -> str:
        return f"gravity of {joints[self.joint - 1]} with weights at {listed(self.points)}"

    def basis(self, arm: Arm) -> dict[str, ca.SX]:
        return {label: self._lever(arm, point) for label, point in zip(self.labels, self.points, strict=True)}

    def _lever(self, arm: Arm, point: str) -> ca.SX:
        if point in OWN:
            at = arm.place(self.joint, OWN[point])
        else:
            at = arm.place(len(arm.frames) if point == FLANGE else int(point[1:]), (0.0, 0.0, 0.0))
        lever = arm.lever(self.joint, at)
        return lever / LEVER if self.revolute else lever
