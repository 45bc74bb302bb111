"""The decision about a calibration on page one: accepted or refused, with what speaks for or against it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Content = Mapping[str, Any]


def decision_text(content: Content) -> dict[str, Any] | None:
    """What the box says; None where results are too old to have a decision.

    Args:
        content: the results dictionary (results.json).
    """
    decision = content.get("decision")
    if decision is None:
        return None
    if decision["accepted"]:
        return {
            "accepted": True,
            "title": "Accepted",
            "lines": [as_sentence(decision["basis"]), *_cautions(decision)],
        }
    lines = [as_sentence(reason["text"]) for reason in decision["reasons"]]
    return {
        "accepted": False,
        "title": "Refused" if decision["tolerance"] else "Refused: do not use these numbers",
        "lines": [*lines, *_cautions(decision)],
    }


def warnings_beside(content: Content) -> list[str]:
    """Warnings of the results without those that the decision says."""
    decision = content.get("decision", {"reasons": (), "cautions": ()})
    said = [*(reason["text"] for reason in decision["reasons"]), *decision["cautions"]]
    return [warning for warning in content.get("warnings", ()) if not any(warning in text for text in said)]


def _cautions(decision: Content) -> list[str]:
    return [f"Caution: {caution}." for caution in decision["cautions"]]


def as_sentence(text: str) -> str:
    """With a capital and a full stop; a name of a parameter or column at its head stays as it is."""
    first = text.split(" ", 1)[0]
    return f"{text if '_' in first else text[:1].upper() + text[1:]}{'' if text.endswith('.') else '.'}"
