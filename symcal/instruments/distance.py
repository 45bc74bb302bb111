"""Distance from the instrument's origin to a point: draw-wire, telescoping ball-bar, distance meter.

h = |p| + offset
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

import casadi as ca
import numpy as np

from symcal.instruments.protocol import Array, Column, Edge, Instrument, Keys, Quantity, sigmas
from symcal.parameters import SCALE, JointPrior, Parameter

SX = ca.SX


class DistanceKeys(Keys):
    """offset: what the instrument reads at a distance of zero, in the file's unit of length, or `unknown`."""

    offset: float | Literal["unknown"] = 0.0


@dataclass(frozen=True, slots=True)
class Distance(Instrument):
    """Distances of points from the instrument's origin.

    offset: reading at zero distance, mm; None: to be found.

    Example:
        >>> import symcal as sc
        >>> sc.Distance(offset=None).has_unknowns, sc.Distance(offset=12.5).has_unknowns
        (True, False)
    """

    name: ClassVar[str] = "distance"
    label: ClassVar[str] = "distances"
    error_words: ClassVar[str] = "error along the distance"
    own: ClassVar[tuple[str, ...]] = ("offset",)
    Config: ClassVar[type[Keys]] = DistanceKeys
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("distance", "mm", 1, 1e-9, sigmas("distance"), "sigma"),)
    columns: ClassVar[tuple[Column, ...]] = (("distance", "mm"),)
    sees: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    offset: float | None = 0.0

    @classmethod
    def configured(cls, keys: Any, edge: Edge) -> Self:
        return cls(None if keys.offset == "unknown" else keys.offset * edge.length)

    @property
    def numbers(self) -> Array:
        return np.array([self.offset or 0.0])

    def unknowns(self, prefix: str) -> tuple[Sequence[Parameter], Sequence[JointPrior]]:
        if self.offset is not None:
            return (), ()
        return (Parameter(f"{prefix}offset", "mm", 0.0, SCALE["mm"], unknown=True),), ()

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return ca.norm_2(point) + own
