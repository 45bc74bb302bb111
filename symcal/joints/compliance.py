r"""A joint that yields to gravity, with known masses:  delta_i = c_i tau_i(q).

    tau_i = sum_k m_k g z_i . ((p_k - o_i) x down),     of prismatic joints sum_k m_k g z_i . down

over the masses that the joint carries and the payload. Source: [Khalil2002]; moments are those of the arm as
it would stand without its terms (a deflection of 3 mrad changes its moment by 0.3 %).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from symcal.joints.arm import Arm, G
from symcal.joints.payload import PAYLOAD
from symcal.joints.term import Number, Term


@dataclass(frozen=True)
class Compliance(Term):
    """What a joint yields per unit of its gravity moment: rad/(N mm), of a prismatic one per unit of force: mm/N."""

    kind: ClassVar[str] = "compliance"
    definition: ClassVar[str] = (
        "compliance * sum of g * kg * L_i(p) over the masses on joint i and later ones, and over the payload; g is "
        "9.80665 N/kg, kg of the payload with what the pose carries beyond nominal"
    )

    @property
    def numbers(self) -> tuple[Number, ...]:
        if self.revolute:
            return (Number("compliance", "rad/Nmm", 2e-8, "gravity"),)
        return (Number("compliance", "mm/N", 1e-4, "gravity"),)

    @property
    def needs_arm(self) -> bool:
        return True

    @property
    def conditions(self) -> tuple[str, ...]:
        return (PAYLOAD,)

    @property
    def said(self) -> str:
        return "the gravity moment of masses and payload" if self.revolute else "the weight of masses and payload"

    def basis(self, arm: Arm) -> dict[str, ca.SX]:
        flange = len(arm.frames)
        carried: list[tuple[ca.SX | float, ca.SX]] = [
            (m.kg, arm.place(m.on, m.at)) for m in arm.masses if m.on >= self.joint
        ]
        carried.append((arm.payload.kg + arm.conditions.get(PAYLOAD, 0), arm.place(flange, arm.payload.at)))
        return {"compliance": sum((G * kg * arm.lever(self.joint, point) for kg, point in carried), ca.SX(0))}
