"""A joint that another one drives along, as wrists do:  delta_j = c * sign_i * ratio_i * q_i."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from symcal.joints.arm import Arm
from symcal.joints.term import Number, Term
from symcal.parameters import Unit

_SIZES: dict[Unit, float] = {"1": 1e-3, "rad/mm": 1e-6, "mm/rad": 1.0}


@dataclass(frozen=True)
class Coupling(Term):
    """by: the joint that drives along, from one; by_revolute: whether that one turns."""

    kind: ClassVar[str] = "coupling"
    definition: ClassVar[str] = "by_q<j> * m_j, with the joint j that drives joint i along"
    keys: ClassVar[tuple[str, ...]] = ("by",)

    by: int = 1
    by_revolute: bool = True

    @property
    def numbers(self) -> tuple[Number, ...]:
        unit: Unit = "1" if self.revolute == self.by_revolute else "rad/mm" if self.revolute else "mm/rad"
        return (Number(f"by_q{self.by}", unit, _SIZES[unit], "coupling"),)

    @property
    def said(self) -> str:
        return f"the reading of joint {self.by}"

    def words(self, joints: Sequence[str]) -> str:
        return f"coupling of {joints[self.joint - 1]} with {joints[self.by - 1]}"

    def basis(self, arm: Arm) -> dict[str, ca.SX]:
        return {self.labels[0]: arm.moved[self.by - 1]}
