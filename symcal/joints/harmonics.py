r"""Waves of a gear, an encoder or a screw:  delta = sum_k s_k sin(k w) + c_k cos(k w).

w is the reading of a revolute joint (rad), of its motor (gear * reading), or 2 pi * reading / pitch of a prismatic one.
Source: eccentric encoders and gears give k = 1, their ovality and strain wave gears k = 2 ([Whitney1986]).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from symcal.joints.arm import Arm
from symcal.joints.term import Number, Term
from symcal.parameters import Unit
from symcal.words import in_short, listed

SX = ca.SX

_SIZES: dict[bool, float] = {True: 0.5e-3, False: 0.05}
"""Plausible amplitude, rad of a revolute joint and mm of a prismatic one."""


@dataclass(frozen=True)
class Harmonics(Term):
    """Sines and cosines of multiples k of a joint's reading.

    k: the multiples. gear: turns of the motor per turn of the joint; with it the waves are the motor's. pitch: mm of a
    prismatic joint per turn.
    """

    kind: ClassVar[str] = "harmonics"
    definition: ClassVar[str] = (
        "sum over k of sin_k * sin(k w) + cos_k * cos(k w); w is q_i of a revolute joint, gear * q_i where gear is "
        "given (the numbers are then motor_sin_k and motor_cos_k), 2 pi q_i / pitch of a prismatic joint"
    )
    keys: ClassVar[tuple[str, ...]] = ("k", "gear", "pitch")

    k: tuple[int, ...] = (1,)
    gear: float | None = None
    pitch: float | None = None

    @property
    def numbers(self) -> tuple[Number, ...]:
        of = "" if self.gear is None else "motor_"
        group = "harmonics" if self.gear is None else "motor harmonics"
        unit: Unit = "rad" if self.revolute else "mm"
        size = _SIZES[self.revolute]
        return tuple(Number(f"{of}{wave}_{k}", unit, size, f"{group} {k}") for k in self.k for wave in ("sin", "cos"))

    @property
    def said(self) -> str:
        of = "of its reading" if self.gear is None else f"of its motor, {self.gear:g} turns per turn"
        of = of if self.pitch is None else f"of its screw, {self.pitch:g} mm per turn"
        return f"waves {in_short([str(k) for k in self.k])} {of}"

    def words(self, joints: Sequence[str]) -> str:
        of = "" if self.gear is None else "motor "
        return f"{of}harmonics {listed([str(k) for k in self.k])} of {joints[self.joint - 1]}"

    def basis(self, arm: Arm) -> dict[str, SX]:
        turn = arm.q[self.joint - 1] * (self.gear or 1.0)
        if self.pitch is not None:
            turn = turn * (2 * math.pi / self.pitch)
        waves = [wave for k in self.k for wave in (ca.sin(k * turn), ca.cos(k * turn))]
        return dict(zip(self.labels, waves, strict=True))
