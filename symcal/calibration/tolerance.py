"""How far a robot's tool may be off: what an identification is accepted or refused against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.units import ANGLE, DEGREES, LENGTH
from symcal.words import number

Array = NDArray[np.float64]
Of = Literal["p95", "rms", "max"]
ERRORS_OF: tuple[Of, ...] = get_args(Of)
"""What of all errors a tolerance holds for: 95 % of them, their root mean square, or every one."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """position: mm, orientation: rad, each None where it does not matter; of: what of the errors must be within.

    Errors are those of measured poses: the noise of the measurement is in them, so that a robot is never better than
    what it was judged by.
    """

    position: float | None = None
    orientation: float | None = None
    of: Of = "p95"

    def __post_init__(self) -> None:
        if self.position is None and self.orientation is None:
            raise InputError("a tolerance says how far off position or orientation may be", key="tolerance")
        for name, value in (("position", self.position), ("orientation", self.orientation)):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError("a tolerance is a positive number", key=name, found=value)
        if self.of not in ERRORS_OF:
            raise InputError("no such statistic of errors", key="of", found=self.of, allowed=ERRORS_OF)

    def limit(self, unit: str) -> float | None:
        """What errors in mm or deg may be; None where the tolerance says nothing of such."""
        return {"mm": self.position, "deg": None if self.orientation is None else self.orientation * DEGREES}.get(unit)

    @property
    def text(self) -> str:
        """`0.500 mm and 0.100 deg`."""
        limits = [(self.limit(unit), unit) for unit in ("mm", "deg")]
        return " and ".join(f"{number(value)} {unit}" for value, unit in limits if value is not None)

    @property
    def facts(self) -> dict[str, Any]:
        """As results.json and calibrated.yaml have it."""
        return {"position_mm": self.limit("mm"), "orientation_deg": self.limit("deg"), "of": self.of}

    @staticmethod
    def recalled(facts: Mapping[str, Any]) -> Tolerance:
        """The tolerance of such `facts`.

        Raises:
            InputError, KeyError, TypeError, ValueError: they are none.
        """
        position, angle = facts["position_mm"], facts["orientation_deg"]
        return Tolerance(
            None if position is None else float(position),
            None if angle is None else float(angle) / DEGREES,
            facts["of"],
        )


def taken_of(of: Of, errors: Array) -> Array:
    """The statistic of errors, shape (..., k), over their last axis."""
    if of == "rms":
        return np.asarray(np.sqrt(np.mean(errors**2, axis=-1)))
    return np.asarray(errors.max(axis=-1) if of == "max" else np.percentile(errors, 95, axis=-1))


def parse_tolerance(text: str, of: str = "p95") -> Tolerance:
    """A tolerance as it is typed: `0.5mm`, `0.1deg`, `0.5 mm,0.1 deg`.

    Raises:
        InputError: no number with a unit of length or angle, or two of a kind.
    """
    found: dict[str, float] = {}
    for part in text.split(","):
        size = part.strip()
        unit = next((u for u in sorted((*LENGTH, *ANGLE), key=len, reverse=True) if size.endswith(u)), None)
        kind = "position" if unit in LENGTH else "orientation"
        try:
            value = float(size[: -len(unit)] if unit else "")
        except ValueError:
            value = np.nan
        if unit is None or not np.isfinite(value) or value <= 0 or kind in found:
            message = "expected a length, an angle or both, each with its unit, such as 0.5mm,0.1deg"
            raise InputError(message, key="--tolerance", found=text)
        found[kind] = value * (LENGTH | ANGLE)[unit]
    if of not in ERRORS_OF:
        raise InputError("no such statistic of errors", key="--of", found=of, allowed=ERRORS_OF)
    return Tolerance(found.get("position"), found.get("orientation"), of)
