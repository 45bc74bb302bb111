r"""What every joint term is: parameters, and by how much the joint moves per unit of each.

    u_i = sign_i ratio_i q_i + offset_i + delta_i,      delta_i = sum_p value_p basis_p(q, link errors, conditions)

q are the readings and u the coordinates of the chain (rad, mm). Every term is linear in its own parameters, so its
basis is its derivative. A basis may depend on all readings and, through gravity moments, on the links (`Arm`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple, Self

import casadi as ca

from symcal.joints.arm import Arm
from symcal.parameters import Unit

SX = ca.SX


@dataclass(frozen=True, slots=True)
class TermParameter:
    """One number of a term.

    name: such as `q2_sin_1`. value: as the robot file has it. scale: plausible size of an error. group: terms of one
    group share one common factor on their sizes, see `symcal.fit.variances`.
    """

    name: str
    unit: Unit
    value: float
    scale: float
    group: str


class Number(NamedTuple):
    """A number of a term: its label (`sin_1`), unit, plausible size and group."""

    label: str
    unit: Unit
    scale: float
    group: str


@dataclass(frozen=True)
class Term(ABC):
    """A joint term.

    joint: which one it moves, from one. revolute: whether that joint turns. values: of its numbers by label, rad, mm,
    1, rad/Nmm or mm/N; zero where not given.
    """

    kind: ClassVar[str]
    definition: ClassVar[str]
    """delta_i in words for who computes it elsewhere, by labels of numbers; of joint i with reading q_i, m_i =
    sign_i ratio_i q_i, L_i(p) the lever of a unit weight at a point p, see `Arm.lever`."""
    keys: ClassVar[tuple[str, ...]] = ()
    """Fields of its own, beside ``values``, that a robot file says."""

    joint: int
    revolute: bool
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    @abstractmethod
    def numbers(self) -> tuple[Number, ...]:
        """What may be identified of it."""

    @abstractmethod
    def basis(self, arm: Arm) -> dict[str, SX]:
        """What the joint moves by per unit of each number, rad or mm per unit."""

    @property
    @abstractmethod
    def said(self) -> str:
        """What it depends on, in words."""

    @property
    def conditions(self) -> tuple[str, ...]:
        """What of a pose it depends on beside joint readings, see `Arm.conditions`."""
        return ()

    @property
    def needs_arm(self) -> bool:
        """Whether it depends on where the links are."""
        return False

    @property
    def parameters(self) -> tuple[TermParameter, ...]:
        return tuple(
            TermParameter(self.name(n.label), n.unit, self.values.get(n.label, 0.0), n.scale, n.group)
            for n in self.numbers
        )

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(n.label for n in self.numbers)

    def unit(self, label: str) -> Unit:
        return next(n.unit for n in self.numbers if n.label == label)

    def name(self, label: str) -> str:
        """What a number is called as a parameter."""
        return f"q{self.joint}_{label}"

    @property
    def acts(self) -> bool:
        """Whether any of its numbers differs from zero."""
        return any(p.value != 0 for p in self.parameters)

    def words(self, joints: Sequence[str]) -> str:
        """What it is called among people, such as `ratio of elbow`, by the joints' names."""
        return f"{self.kind} of {joints[self.joint - 1]}"

    def corrected(self, errors: Mapping[str, float]) -> Self:
        """With errors added to its numbers, by parameter name."""
        values = {label: self.values.get(label, 0.0) + errors.get(self.name(label), 0.0) for label in self.labels}
        return replace(self, values=values)

    def entry(self) -> dict[str, Any]:
        """Its own keys as a robot file says them, lengths in mm."""
        return {key: getattr(self, key) for key in self.keys}
