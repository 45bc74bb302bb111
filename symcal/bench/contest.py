"""A contest: one piece of work, done by us and by peers, checked against each other and then measured together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from symcal.bench.rounds import Contender, Pace, measure, summary

Progress = Callable[[str], None]

LEFT_OUT = "left out by --quick"


@dataclass(frozen=True, slots=True)
class Entry:
    """One who takes part. difference: of its result from ours, by which it is judged; largest that is let pass."""

    contender: Contender
    difference: float = 0.0
    allowed: float = 0.0

    @property
    def agrees(self) -> bool:
        return self.difference <= self.allowed


@dataclass(frozen=True, slots=True)
class Contest:
    """name: of what is done. size: how much at once. unit: what a time is of. reference: whose time is 1.

    compared: what `Entry.difference` is of. absent: who is left out, with the reason.
    """

    subject: str
    name: str
    size: int
    unit: str
    reference: str | None
    compared: str
    entries: tuple[Entry, ...]
    absent: dict[str, str] = field(default_factory=dict)


def hold(contest: Contest, pace: Pace, names: tuple[str, ...] | None = None) -> dict[str, Any]:
    """Measure all that agree, or of these those that are named; the content of one contest in bench.json."""
    wanted = [entry for entry in contest.entries if names is None or entry.contender.name in names]
    taking_part = [entry for entry in wanted if entry.agrees]
    kept = summary(measure(tuple(entry.contender for entry in taking_part), pace), contest.reference)
    absent = dict(contest.absent)
    for entry in wanted:
        if not entry.agrees:
            by = f"{entry.difference:.1e}, allowed {entry.allowed:g}"
            absent[entry.contender.name] = f"computes something else: {contest.compared} differ by {by}"
    return {
        "subject": contest.subject,
        "name": contest.name,
        "size": contest.size,
        "unit": contest.unit,
        "reference": contest.reference,
        "compared": contest.compared,
        "entries": [
            {"name": e.contender.name, "what": e.contender.what, "difference": e.difference, **kept[e.contender.name]}
            for e in taking_part
        ],
        "absent": absent,
    }
