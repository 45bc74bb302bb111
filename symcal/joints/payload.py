"""What a joint yields to a payload that changes from pose to pose:  delta_i = p_i * kg * (lever / 300 mm).

kg is what a pose carries beyond the robot file's payload; the lever that of the payload's centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from symcal.joints.arm import Arm
from symcal.joints.gravity import LEVER
from symcal.joints.term import Number, Term

PAYLOAD = "payload"
"""Condition: kg that a pose carries beyond the robot file's payload."""

_SIZES: dict[bool, float] = {True: 0.1e-3, False: 0.01}


@dataclass(frozen=True)
class PayloadTerm(Term):
    """Deflection by 1 kg on a horizontal arm of 300 mm, rad; of a prismatic joint by 1 kg along it, mm."""

    kind: ClassVar[str] = "payload"
    definition: ClassVar[str] = (
        "payload * kg * L_i(p) / 300 mm, of a prismatic joint payload * kg * L_i; kg is what the pose carries beyond "
        "the nominal payload, p the centre of the payload"
    )

    @property
    def numbers(self) -> tuple[Number, ...]:
        return (Number("payload", "rad" if self.revolute else "mm", _SIZES[self.revolute], "payload"),)

    @property
    def needs_arm(self) -> bool:
        return True

    @property
    def conditions(self) -> tuple[str, ...]:
        return (PAYLOAD,)

    @property
    def said(self) -> str:
        return f"the {'gravity moment' if self.revolute else 'weight'} of what a pose carries beyond nominal"

    def words(self, joints: Sequence[str]) -> str:
        return f"yielding of {joints[self.joint - 1]} to payloads"

    def basis(self, arm: Arm) -> dict[str, ca.SX]:
        lever = arm.lever(self.joint, arm.place(len(arm.frames), arm.payload.at))
        return {"payload": arm.conditions[PAYLOAD] * (lever / LEVER if self.revolute else lever)}
