"""What every instrument read and how well it is explained, where there is more than one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.report.measured import noise_of, what_is_read
from symcal.words import number

Content = Mapping[str, Any]

_NONE = "–"
_WORDS = {"train": "training", "test": "held-out"}


def instruments_text(content: Content) -> dict[str, Any] | None:
    """A row per instrument; None for one alone, of which the rest of the report speaks.

    Args:
        content: the results dictionary (results.json).
    """
    found = content.get("instruments", {})
    if len(found) < 2:
        return None
    parts = [part for part in ("train", "test") if any(part in facts["accuracy"] for facts in found.values())]
    return {
        "parts": [_WORDS[part] for part in parts],
        "rows": [_row(content, facts, parts) for facts in found.values()],
        "note": (
            "Every instrument in its own unit. Readings are counted as observations, one per point, axis or frame that "
            "was read; errors are rms, before → after the identification. Noise is the standard deviation per axis."
        ),
    }


def _row(content: Content, facts: Mapping[str, Any], parts: list[str]) -> list[str]:
    states = [facts["accuracy"].get(part, {}) for part in parts]
    return [
        facts["name"],
        what_is_read(facts),
        facts["on"],
        *(cell for each in states for cell in _cells(each, facts["unit"])),
        noise_of(content, facts),
    ]


def _cells(states: Mapping[str, Any], unit: str) -> tuple[str, str]:
    """How many readings there are in a part of the data, and their rms before and after."""
    if not states:
        return _NONE, _NONE
    rms = [number(states[state]["rms"]) for state in ("before", "after") if state in states]
    return str(states["after"]["count"]), f"{' → '.join(rms)} {unit}"
