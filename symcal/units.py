"""Units at the edge of the program: inside, lengths are mm and angles rad."""

from __future__ import annotations

import math
from typing import Literal

LengthUnit = Literal["mm", "m", "um", "cm", "in"]
AngleUnit = Literal["deg", "rad", "mrad"]

LENGTH: dict[str, float] = {"mm": 1.0, "m": 1000.0, "um": 1e-3, "cm": 10.0, "in": 25.4}
"""mm per unit."""
ANGLE: dict[str, float] = {"rad": 1.0, "deg": math.pi / 180, "mrad": 1e-3}
"""rad per unit."""
PIXEL: dict[str, float] = {"px": 1.0}
"""px per unit."""
DEGREES = 180 / math.pi
"""deg per rad."""
SHOWN: dict[str, tuple[str, float]] = {
    "mm": ("mm", 1.0),
    "rad": ("deg", DEGREES),
    "px": ("px", 1.0),
    "1": ("1", 1.0),
    "rad/mm": ("mrad/m", 1e6),
    "mm/rad": ("mm/rad", 1.0),
    "rad/Nmm": ("µrad/(N m)", 1e9),
    "mm/N": ("µm/N", 1e3),
}
"""In what people are shown a parameter, and how many of that one of the program's units is; see `in_mrad`."""
SHOWN_UNITS: dict[str, str] = {unit: SHOWN[unit][0] for unit in ("mm", "rad", "px")}
"""In what people are shown what instruments read."""


def in_mrad(unit: str) -> tuple[str, float]:
    """`SHOWN` where small angles are shown in mrad."""
    return ("mrad", 1e3) if unit == "rad" else SHOWN[unit]


def unit_factor(unit: str, length: float, angle: float) -> float:
    """What one of a file's units is in the program's: of mm, rad, 1 and their ratios (rad/mm, rad/Nmm, ...).

    Args:
        length, angle: mm and rad per unit of the file; newtons stay.
    """
    top, _, bottom = unit.partition("/")
    factors = {"mm": length, "rad": angle, "Nmm": length}
    return factors.get(top, 1.0) / factors.get(bottom, 1.0)


def split_unit(column: str) -> tuple[str, str | None]:
    """`'q1_deg'` as `('q1', 'deg')`; the unit is None when the name ends in none that is known."""
    stem, _, last = column.rpartition("_")
    if stem and last in LENGTH | ANGLE | PIXEL:
        return stem, last
    return column, None
