"""What a decision about a calibration is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from symcal.calibration.claims import Outside, judging_part
from symcal.calibration.evaluate import Errors
from symcal.calibration.reasons import Reason


@dataclass(frozen=True, slots=True)
class Sizes:
    """Errors of position, mm, and of orientation, deg; None where they cannot be told."""

    mm: float | None = None
    deg: float | None = None

    def of(self, unit: str) -> float | None:
        return {"mm": self.mm, "deg": self.deg}.get(unit)


@dataclass(frozen=True, slots=True)
class Lack:
    """What the model lacks, in words, and how large that is in the residuals, rms in ``unit`` (mm or deg)."""

    what: str
    rms: float
    unit: str


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a run found that a decision is made of; what was not looked at is empty.

    errors: by part (`train`, `test`, `cross_validation`, `left_out`) and state. trouble: why the fit is none.
    implausible: corrections beyond measure. conceivable: parameters among them that an error of the robot file may
    explain. uncalibrated: errors (rms) of a robot that was never calibrated, by its plausible sizes, the stated noise
    of the measurement included. open: errors that the uncertainty of the parameters lets expect, ``over`` (`the working
    area`), by the statistic of the tolerance. foremost: the parameter that has the largest part in that of position.
    outside: postures that the measured poses do not reach. lacks: what the model lacks. outliers, mistakes, halves: of
    results.json. aside: held-out poses that are gross slips: by number, their label. large: of joint terms, in words.
    frames_only: no robot was calibrated, its poses being data (`symcal.robot.given`): there is no nominal one to beat.
    """

    errors: Mapping[str, Mapping[str, Errors]]
    trouble: str = ""
    implausible: tuple[Reason, ...] = ()
    uncalibrated: Sizes = Sizes()
    open: Sizes = Sizes()
    over: str = "the measured poses"
    foremost: str = ""
    outside: Outside | None = None
    lacks: tuple[Lack, ...] = ()
    outliers: Sequence[Mapping[str, Any]] = ()
    mistakes: Sequence[Mapping[str, Any]] = ()
    halves: Mapping[str, Any] | None = None
    aside: Mapping[int, str] = field(default_factory=dict)
    large: tuple[str, ...] = ()
    conceivable: frozenset[str] = frozenset()
    frames_only: bool = False

    @property
    def part(self) -> str | None:
        """The part of the data that judges; None where nothing was left out of the identification."""
        return judging_part(self.errors)
