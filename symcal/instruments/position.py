"""Positions of target points: laser tracker, motion capture, probing.

h = p
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from symcal.instruments.protocol import Array, Draw, Quantity, Unit

SX = ca.SX


@dataclass(frozen=True, slots=True)
class Position:
    name: str = "position"
    quantities: tuple[Quantity, ...] = (
        Quantity("position", "mm", 3, 1e-9, ("sigma_x", "sigma_y", "sigma_z"), "sigma"),
    )
    columns: tuple[tuple[str, Unit | None], ...] = (("x", "mm"), ("y", "mm"), ("z", "mm"))
    reads_points: bool = True
    gives_point: bool = True
    error_words: str = "tool error"
    place: tuple[str, ...] = ()
    own: tuple[str, ...] = ()

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return point

    def residual(self, rotation: SX, point: SX, reading: SX, own: SX) -> SX:
        return point - reading

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        return ca.horzcat(SX(3, 3), SX.eye(3)), SX(3, 0)

    def error(self, rotation: SX, point: SX, reading: SX, own: SX, *, riding: bool) -> tuple[SX, SX]:
        return point - reading, SX(0, 1)

    def retract(self, reading: Array, noise: Mapping[str, Draw]) -> Array:
        return reading + noise["position"](reading.shape)
