"""Quantiles and shares of trials with intervals that hold for any law, and what each cell of a study comes to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, bdtrik, betaincinv

from symcal.trials.judge import FAILED, OK, REFUSED
from symcal.trials.store import Store

Array = NDArray[np.float64]

CONFIDENCE = 0.95
SHOWN = {"p05": 0.05, "p25": 0.25, "median": 0.5, "p75": 0.75, "p95": 0.95}
"""Quantiles that results.json has of every figure."""


@dataclass(frozen=True, slots=True)
class Quantile:
    """A quantile of a law, from R values: the estimate, and bounds between which it is with 95 % confidence; infinite
    where so few values say nothing, or trials that failed would be in it."""

    value: float
    low: float
    high: float

    def facts(self) -> dict[str, float | None]:
        numbers = {"value": self.value, "low": self.low, "high": self.high}
        return {name: float(number) if np.isfinite(number) else None for name, number in numbers.items()}


def quantile(values: Array, share: float) -> Quantile:
    """Quantile of a sorted sample, between its neighbours linearly; the bounds are order statistics, whose ranks follow
    from the binomial law of how many values are below the true one, whatever these are of. [David2003], section 7.1.

    Args:
        values: in ascending order, shape (R,); infinite ones count as larger than all.
    """
    count = len(values)
    if not count:
        return Quantile(np.inf, 0.0, np.inf)
    place = share * (count - 1)
    low = int(place)
    high = min(low + 1, count - 1)
    value = values[low]
    if place > low:
        value = np.inf if np.isinf(values[high]) else value + (place - low) * (values[high] - value)
    first, last = _binomial(count, share, (1 - CONFIDENCE) / 2), _binomial(count, share, (1 + CONFIDENCE) / 2) + 1
    return Quantile(
        float(value),
        float(values[first - 1]) if first >= 1 else 0.0,
        float(values[last - 1]) if last <= count else np.inf,
    )


def _binomial(count: int, share: float, probability: float) -> int:
    """The least k that so many of ``count`` are at most with this probability."""
    k = max(int(np.ceil(bdtrik(probability, count, share))), 0)
    while k > 0 and bdtr(k - 1, count, share) >= probability:
        k -= 1
    return k


@dataclass(frozen=True, slots=True)
class Share:
    """k of n, with bounds of the probability behind it, each wrong with 2.5 % at most ([Clopper1934])."""

    count: int
    of: int

    @property
    def value(self) -> float:
        return self.count / self.of if self.of else float("nan")

    @property
    def low(self) -> float:
        tail = (1 - CONFIDENCE) / 2
        return 0.0 if self.count == 0 else float(betaincinv(self.count, self.of - self.count + 1, tail))

    @property
    def high(self) -> float:
        tail = (1 - CONFIDENCE) / 2
        return 1.0 if self.count == self.of else float(betaincinv(self.count + 1, self.of - self.count, 1 - tail))

    def below(self, probability: float) -> float:
        """Chance of so few, or fewer, where each has this probability."""
        return float(bdtr(self.count, self.of, probability))

    def facts(self) -> dict[str, Any]:
        value = self.value if self.of else None
        return {"count": self.count, "of": self.of, "share": value, "low": self.low, "high": self.high}


def pooled(shares: Sequence[Mapping[str, Any]]) -> Share:
    """Several shares, as results.json has them, as one."""
    return Share(sum(s["count"] for s in shares), sum(s["of"] for s in shares))


@dataclass(frozen=True, slots=True)
class Question:
    """of: which error of a trial is judged (a column). share: of the trials that should be within tolerance, mm."""

    of: str
    share: float
    tolerance: float | None


def judged_column(of: str, against: str) -> str:
    """The column of the error that is judged."""
    return of if against == "truth" else f"measured_{of}"


def judged_values(store: Store, number: int, column: str, repetitions: int) -> Array:
    """The judged errors of all trials of a cell, ascending, shape (R,): of trials that failed or were refused
    infinite."""
    values = np.sort(store.numbers(number, column)[column])
    return np.concatenate([values, np.full(repetitions - len(values), np.inf)])


def cell_facts(store: Store, number: int, question: Question, repetitions: int, names: Sequence[str]) -> dict[str, Any]:
    """Everything that results.json says of a cell.

    Trials that failed or were refused count as errors larger than any.

    Args:
        names: of the parameters whose intervals are judged.
    """
    statuses = store.statuses(number)
    good = statuses.get(OK, 0)
    found = store.numbers(
        number,
        "mean",
        "rms",
        "p95",
        "max",
        "before_rms",
        "foretold_rms",
        "found_rms",
        "probe",
        "rank",
        "iterations",
    )
    judged = judged_values(store, number, question.of, repetitions)
    out: dict[str, Any] = {
        "trials": {"ok": good, **{status: statuses.get(status, 0) for status in (FAILED, REFUSED)}},
        "reasons": [{"reason": reason, "trials": count} for reason, count in store.reasons(number)[:5]],
        "error_mm": {
            of: {name: quantile(np.sort(found[of]), share).facts()["value"] for name, share in SHOWN.items()}
            for of in ("mean", "rms", "p95", "max")
        },
        "judged_mm": {
            **{name: quantile(judged, share).facts() for name, share in SHOWN.items()},
            "at_share": quantile(judged, question.share).facts(),
        },
        "within": None,
        "before_rms_mm": None,
        "expected": None,
        "coverage": None,
        "rank": None,
        "iterations": None,
    }
    if question.tolerance is not None:
        out["within"] = Share(int((judged <= question.tolerance).sum()), repetitions).facts()
    if good:
        out["before_rms_mm"] = float(np.median(found["before_rms"]))
        out["expected"] = _expected(found["foretold_rms"], found["found_rms"])
        out["coverage"] = {
            "position": Share(int((np.abs(found["probe"]) <= 1).sum()), good).facts(),
            "parameters": _intervals(store.intervals(number), names),
        }
        out["rank"] = {"least": int(found["rank"].min()), "most": int(found["rank"].max())}
        out["iterations"] = {"median": float(np.median(found["iterations"])), "most": int(found["iterations"].max())}
    return out


def _expected(foretold: Array, found: Array) -> dict[str, float | None]:
    """Rms over trials of the errors, foretold and found, and the latter over the former with its standard error."""
    count = len(found)
    squares, expected = found**2, foretold**2
    ratio = float(np.sqrt(squares.mean() / expected.mean()))
    # of a ratio of means, to first order
    spread = (squares - ratio**2 * expected) / expected.mean()
    error = None if count < 2 else float(np.sqrt((spread**2).sum() / (count - 1) / count) / (2 * ratio))
    return {
        "foretold_rms_mm": float(np.sqrt(expected.mean())),
        "found_rms_mm": float(np.sqrt(squares.mean())),
        "ratio": ratio,
        "ratio_error": error,
    }


def _intervals(letters: NDArray[np.str_], names: Sequence[str]) -> Mapping[str, Any]:
    """Of every parameter: in how many trials the data told it, and in how many of these its interval held."""
    out = {}
    for i, name in enumerate(names):
        own = letters[:, i]
        told = np.char.isupper(own)
        held = np.char.upper(own) == "I"
        out[name] = {
            "told": int(told.sum()),
            "held": Share(int((told & held).sum()), int(told.sum())).facts(),
            "held_untold": Share(int((~told & held).sum()), int((~told).sum())).facts(),
        }
    return out
