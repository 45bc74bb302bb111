"""What every instrument read and how well it is explained, where there is more than one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from symcal.report.measured import by_entry, noise_of, what_is_read
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
    groups = by_entry(list(found.values()))
    constrains = [facts.get("constrains", False) for facts in found.values()]
    counted = "contacts" if all(constrains) else "readings"
    if all(constrains):
        note = "Every posture that touches is a contact; errors are rms, before → after the identification."
    else:
        note = (
            "Every instrument in its own unit. Readings are counted as observations, one per point, axis or frame that "
            "was read; errors are rms, before → after the identification."
        )
    if any(constrains) and not all(constrains):
        note += " Of what is touched the contacts are counted."
    if any(len(own) > 1 for own in groups.values()):
        note += " What holds for all sessions of an entry is said once."
    return {
        "parts": [_WORDS[part] for part in parts],
        "counted": counted,
        "groups": [_group(content, own, parts) for own in groups.values()],
        "note": f"{note} Noise is the standard deviation per axis.",
    }


def _group(content: Content, own: Sequence[Mapping[str, Any]], parts: list[str]) -> dict[str, Any]:
    """The sessions of an entry: what they share, and a row for each."""
    first = own[0]
    rows = []
    for facts in own:
        states = [facts["accuracy"].get(part, {}) for part in parts]
        rows.append([facts["name"], *(cell for each in states for cell in _cells(each, facts["unit"]))])
    return {"reads": what_is_read(first), "on": first["on"], "noise": noise_of(content, first), "rows": rows}


def _cells(states: Mapping[str, Any], unit: str) -> tuple[str, str]:
    """How many readings there are in a part of the data, and their rms before and after."""
    if not states:
        return _NONE, _NONE
    rms = [number(states[state]["rms"]) for state in ("before", "after") if state in states]
    return str(states["after"]["count"]), f"{' → '.join(rms)} {unit}"
