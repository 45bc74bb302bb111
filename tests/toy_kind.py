"""A kind of instrument in one file: the height of a point above a plane, read with a level that has a scale error.

h = (1 + k) n . p        n: the plane's normal in the instrument's frame
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

import symcal as sc
from symcal.instruments import Edge, Keys
from symcal.parameters import Parameter


class LevelKeys(Keys):
    """stretched: whether the staff's scale error is to be found."""

    stretched: bool = False


@sc.register
@dataclass(frozen=True, slots=True)
class Level(sc.Instrument):
    name: ClassVar[str] = "level"
    label: ClassVar[str] = "heights"
    error_words: ClassVar[str] = "error in height"
    own: ClassVar[tuple[str, ...]] = ("scale",)
    Config: ClassVar[type[Keys]] = LevelKeys
    quantities: ClassVar[tuple[sc.Quantity, ...]] = (sc.Quantity("height", "mm", 1, 1e-9, ("sigma_height",), "sigma"),)
    columns: ClassVar[tuple[tuple[str, str], ...]] = (("height", "mm"),)
    sees: ClassVar[tuple[str, ...]] = ("z", "rx", "ry")
    stretched: bool = False
    scale: float = 0.0

    @classmethod
    def configured(cls, keys: Any, _edge: Edge) -> Level:
        return cls(keys.stretched)

    @property
    def numbers(self) -> np.ndarray:
        return np.array([self.scale])

    def unknowns(self, prefix: str) -> Any:
        return ((Parameter(f"{prefix}scale", "1", 0.0, 1e-3, unknown=True),) if self.stretched else ()), ()

    def predict(self, _rotation: ca.SX, point: ca.SX, own: ca.SX) -> ca.SX:
        return (1 + own) * point[2]
