"""What is known between things, beside what it came out as; and what readings without lengths cannot tell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.report.measured import observers
from symcal.words import fixed, number

Content = Mapping[str, Any]

_PLACES = 3  # decimals of a value in mm and deg
_PER_METRE = 1e3  # mm of a share, for each metre


def known_table(known: Mapping[str, Mapping[str, Any]]) -> dict[str, Any] | None:
    """A row for each known value; None where nothing is known.

    Args:
        known: of results.json.
    """
    if not known:
        return None
    note = "Known with this standard deviation, and what it is after the identification."
    if not all(facts["used"] for facts in known.values()):
        note += (
            " A check took no part in the identification: only held-out poses tell where its things stand, and they "
            "were placed by these alone."
        )
    return {"rows": [_row(name, facts) for name, facts in known.items()], "note": note}


def _row(name: str, facts: Mapping[str, Any]) -> list[str]:
    first, second = facts["between"]
    return [
        name,
        f"{facts['type']} from {first} to {second}{'' if facts['used'] else ' (a check)'}",
        *known_numbers(facts),
    ]


def known_numbers(facts: Mapping[str, Any]) -> list[str]:
    """Value, its standard deviation and what was found, each with its unit."""
    found = facts["found"]
    return [
        f"{', '.join(fixed(v, _PLACES) for v in facts['value'])} {facts['unit']}",
        f"{', '.join(number(v, 2) for v in dict.fromkeys(facts['sigma']))} {facts['unit']}",
        "–" if found is None else f"{', '.join(fixed(v, _PLACES) for v in found)} {facts['unit']}",
    ]


def unseen_length(content: Content) -> dict[str, str] | None:
    """What readings without lengths cannot see, with its number; None where lengths are seen.

    Args:
        content: the results dictionary (results.json).
    """
    length = content["identifiability"].get("length")
    if not length:
        return None
    touched = all(facts.get("constrains", False) for facts in observers(content))
    who = "contacts" if touched else "these readings"
    same = "every posture would touch as it does" if touched else "every reading would be the same"
    told = (
        "Only known values, places and points tell that share, beside the plausible sizes of the lengths"
        if length["known"]
        else "Nothing that was measured tells that share: the plausible sizes of the lengths hold it"
    )
    more = "over a longer way" if length["known"] else "between two places"
    return {
        "title": f"What {who} cannot see",
        "text": (
            f"How long the arm is. If all lengths grew by one share, those of the links and of the tool with the "
            f"distances between the places, {same}. {told}. It stands at {fixed(100 * length['growth'], 3)} % with a "
            f"standard deviation of {number(100 * length['sigma'], 2)} %, which is "
            f"{number(_PER_METRE * length['sigma'], 2)} mm for each metre. A known distance {more}, or an "
            "instrument that reads lengths, would tell it better; more postures would not."
        ),
    }
