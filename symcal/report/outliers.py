"""Readings that the noise of the others does not explain, and by which loss the fit was made."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.words import number, percent, plural, symbol

Content = Mapping[str, Any]

_SHOWN = 12  # rows; all of them are in a table of their own
_LOSSES = {
    "linear": "linear: every residual counts by its square",
    "huber": "Huber's: residuals beyond the noise count by their size, not by its square",
    "cauchy": "Cauchy's: the further off a reading, the less it counts",
    "tukey": "Tukey's: what is far off does not count at all",
}


def outliers_text(content: Content) -> dict[str, Any] | None:
    """A row for each of the furthest; None where there are none.

    Args:
        content: the results dictionary (results.json).
    """
    found = content.get("outliers", [])
    if not found:
        return None
    several = len({each["instrument"] for each in found}) > 1
    more = len(found) - _SHOWN
    note = (
        f"{plural(len(found), 'reading')} that the noise of the others does not explain: how far from where all other "
        "readings put it, with which weight it counted, and what would change without it: the parameter that moves "
        "most, in its own standard deviations, and the tool (rms over the training poses)."
    )
    if more > 0:
        note += f" {more} more are in tables/outliers.csv."
    return {"rows": [_row(each, several) for each in found[:_SHOWN]], "note": note}


def _row(each: Mapping[str, Any], several: bool) -> list[str]:
    read = " ".join(part for part in (each["instrument"] if several else each["quantity"], each["point"]) if part)
    return [
        each["pose"] + (" (test)" if each.get("split") == "test" else ""),
        read,
        f"{number(each['off'])} {each['unit']}",
        number(each["noises"]),
        percent(each["weight"]),
        f"{symbol(each['parameter'])} {number(each['sigmas'], 2)}" if each["parameter"] else "–",
        f"{number(each['tool_mm'], 2)} mm",
    ]


def loss_words(content: Content) -> str | None:
    """Which loss, and why where it was chosen; None in results that do not say."""
    found = content["identification"]
    if "loss" not in found:
        return None
    words, choice = _LOSSES[found["loss"]], found.get("loss_choice")
    return words if choice is None else f"{words}. Chosen by cross-validation: {choice['why']}"
