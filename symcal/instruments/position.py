"""Positions of target points: laser tracker, motion capture, probing.

h = p
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from symcal.instruments.protocol import Column, Instrument, Quantity, sigmas

SX = ca.SX


@dataclass(frozen=True, slots=True)
class Position(Instrument):
    """Positions of points; `Tracker` is another name of it.

    Example:
        >>> import symcal as sc
        >>> sc.Position().columns
        (('x', 'mm'), ('y', 'mm'), ('z', 'mm'))
    """

    name: ClassVar[str] = "position"
    label: ClassVar[str] = "positions"
    gives_point: ClassVar[bool] = True
    makes_world: ClassVar[bool] = True
    error_words: ClassVar[str] = "tool error"
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("position", "mm", 3, 1e-9, sigmas(*"xyz"), "sigma"),)
    columns: ClassVar[tuple[Column, ...]] = (("x", "mm"), ("y", "mm"), ("z", "mm"))

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return point

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        return ca.horzcat(SX(3, 3), SX.eye(3)), SX(3, 0)
