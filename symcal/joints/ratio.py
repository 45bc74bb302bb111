"""An error of a gear's ratio, an encoder's or a scale's:  delta = e * sign * ratio * q."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from symcal.joints.arm import Arm
from symcal.joints.term import Number, Term


@dataclass(frozen=True)
class Ratio(Term):
    """The relative error of how far a joint moves per reading."""

    kind: ClassVar[str] = "ratio"
    definition: ClassVar[str] = "ratio * m_i"

    @property
    def numbers(self) -> tuple[Number, ...]:
        return (Number("ratio", "1", 1e-3, "ratio"),)

    @property
    def said(self) -> str:
        return "its reading"

    def basis(self, arm: Arm) -> dict[str, ca.SX]:
        return {"ratio": arm.moved[self.joint - 1]}
