"""The grid of a study: every combination of what differs, in one order that never changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any

from symcal.config.experiment import ExperimentFile
from symcal.config.trials import MOST_CELLS, MOST_TRIALS, RANDOM, StudyFile
from symcal.documents.document import Document

NOISE = "noise_"
"""Before a quantity: the axis of the grid that is its noise."""


def axes(
    study: StudyFile, document: Document, experiment: ExperimentFile, entries: tuple[str, ...], noises: tuple[str, ...]
) -> dict[str, list[Any]]:
    """Values by axis, the slowest first: what the study says, else the one value of the experiment.

    Args:
        entries: names of the experiment's instruments. noises: quantities that they read with noise.
    Raises:
        InputError: an instrument or a quantity that is not there, or a grid that is too large.
    """
    vary = study.vary
    for name in vary.noise:
        if name not in noises:
            raise document.error("no instrument reads this", ("vary", "noise", name), found=name, allowed=noises)
    sets = [tuple(names) for names in vary.instruments] if vary.instruments else [entries]
    for i, names in enumerate(sets):
        for name in names:
            if name not in entries:
                raise document.error("no such instrument", ("vary", "instruments", i), found=name, allowed=entries)
        if len(set(names)) < len(names):
            raise document.error("an instrument stands here twice", ("vary", "instruments", i), found=list(names))
    found: dict[str, list[Any]] = {
        "instruments": [tuple(name for name in entries if name in names) for names in sets],
        "plan": vary.plan or [experiment.plan.method or RANDOM],
        "errors": vary.errors or ["fixed"],
        "size": vary.size or [1.0],
        **{f"{NOISE}{name}": sizes for name, sizes in vary.noise.items()},
        "poses": vary.poses or [experiment.plan.poses],
    }
    cells = 1
    for values in found.values():
        cells *= len(values)
    if cells > MOST_CELLS:
        raise document.error(f"a grid of {cells} cells: at most {MOST_CELLS}", ("vary",))
    if cells * study.repetitions > MOST_TRIALS:
        message = f"{cells} cells of the grid with {study.repetitions} trials each: at most {MOST_TRIALS} in all"
        raise document.error(message, ("repetitions",), found=study.repetitions)
    return found


def combinations(found: Mapping[str, list[Any]]) -> Iterator[dict[str, Any]]:
    """Every cell's values by axis, the last axis fastest."""
    for values in product(*found.values()):
        yield dict(zip(found, values, strict=True))


def varied(found: Mapping[str, list[Any]]) -> tuple[str, ...]:
    """Axes with more than one value."""
    return tuple(name for name, values in found.items() if len(values) > 1)
