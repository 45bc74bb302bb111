"""All subjects in one run, and the content of bench.json."""

from __future__ import annotations

from typing import Any

from symcal.bench import commands, growth, identifications, positions
from symcal.bench.contest import Progress
from symcal.bench.machine import BUSY, PEERS, load, machine, one_core, version
from symcal.bench.rounds import FULL, QUICK, Pace
from symcal.errors import InputError

SCHEMA = "symcal/bench/1"
SUBJECTS = (positions.SUBJECT, identifications.SUBJECT, commands.SUBJECT, growth.SUBJECT)

_ABSENT = {
    None: "not installed",
    "robotkinecal": "not installed; it wants numpy < 2 and cannot stand beside symcal",
}
_FEW, _FEWEST = Pace(rounds=7, sample_s=0.005, slow_s=0.5), Pace(rounds=3, sample_s=0.002, slow_s=0.1)
"""Of a point of a curve."""


def run_bench(*, quick: bool = False, only: str | None = None, progress: Progress = lambda _: None) -> dict[str, Any]:
    """Measure, one subject after the other: on one core, but for whole commands, which have all.

    Args:
        quick: less of everything: seconds instead of minutes. only: one of `SUBJECTS`.
    Raises:
        InputError: there is no such subject.
    """
    if only is not None and only not in SUBJECTS:
        raise InputError("no such subject", key="--only", found=only, allowed=SUBJECTS)
    chosen = SUBJECTS if only is None else (only,)
    facts = machine()
    pace, few = (QUICK, _FEWEST) if quick else (FULL, _FEW)
    held: list[dict[str, Any]] = []
    curves: list[dict[str, Any]] = []
    with one_core():
        if positions.SUBJECT in chosen:
            held.extend(
                positions.run(positions.QUICK_SIZES if quick else positions.SIZES, pace, progress, slow=not quick)
            )
        if identifications.SUBJECT in chosen:
            held.extend(identifications.run(identifications.BATCH, pace, progress, slow=not quick))
        if growth.SUBJECT in chosen:
            curves.extend(growth.run(growth.QUICK_SIZES if quick else growth.FULL_SIZES, few, progress))
    if commands.SUBJECT in chosen:  # not held to one core, which children would inherit
        held.append(commands.run(2 if quick else 5, progress, slow=not quick))
    return {
        "schema": SCHEMA,
        "quick": quick,
        "machine": facts,
        "load_at_end": load(),
        "peers": {name: version(name) or _ABSENT.get(name, _ABSENT[None]) for name in PEERS},
        "warnings": _warnings(facts),
        "contests": held,
        "growth": curves,
    }


def _warnings(facts: dict[str, Any]) -> list[str]:
    busy = facts["load"]
    if busy is None or busy <= BUSY:
        return []
    return [
        f"{busy:g} processes wanted to run on {facts['cores']} cores in the minute before: processor times and ratios "
        "are worth more than times of the clock, and less than on a quiet machine"
    ]
