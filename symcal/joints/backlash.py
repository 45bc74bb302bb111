"""Play of a joint: it stops half a width short of its reading on the side it came from,  delta = -b * direction.

The direction of approach (-1, 1; 0 where it is not known: the middle) comes with the data, from a column or from the
order of the poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from symcal.joints.arm import Arm
from symcal.joints.term import Number, Term

_SIZES: dict[bool, float] = {True: 0.2e-3, False: 0.02}


def direction_name(joint: int) -> str:
    """Condition and column of the direction in which a joint came to its reading."""
    return f"q{joint}_direction"


@dataclass(frozen=True)
class Backlash(Term):
    """Half the width of the play, rad or mm."""

    kind: ClassVar[str] = "backlash"
    definition: ClassVar[str] = (
        "-backlash * direction_i; the direction in which joint i came to its reading, -1 or 1, 0 where it is not known"
    )

    @property
    def numbers(self) -> tuple[Number, ...]:
        return (Number("backlash", "rad" if self.revolute else "mm", _SIZES[self.revolute], "backlash"),)

    @property
    def conditions(self) -> tuple[str, ...]:
        return (direction_name(self.joint),)

    @property
    def said(self) -> str:
        return f"the direction it came from ({direction_name(self.joint)})"

    def basis(self, arm: Arm) -> dict[str, ca.SX]:
        return {"backlash": -arm.conditions[direction_name(self.joint)]}
