"""What was learnt from the data and what is assumed, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.words import MOSTLY, free_parameters, is_link_parameter, is_term_number, listed, symbol

Parameters = Mapping[str, Mapping[str, Any]]

_MOST_NAMED = 10


def was_learnt(parameter: Mapping[str, Any]) -> bool:
    """Whether the data took away at least half of the uncertainty about a parameter of results.json."""
    return parameter["learnt"] is not None and parameter["learnt"] >= MOSTLY


def learnt_and_assumed(parameters: Parameters) -> str:
    """How many of the free parameters of links and joint terms were mostly learnt, and which ones were not; empty if
    none is free."""
    names = [name for name, p in parameters.items() if (is_link_parameter(name) or is_term_number(name)) and p["free"]]
    of_terms = any(is_term_number(name) for name in names)
    what = "free parameter of links and joint terms" if of_terms else "free link parameter"
    assumed = [name for name in names if not was_learnt(parameters[name])]
    if not names:
        return ""
    if not assumed:
        return f"Every {what} ({len(names)} in all) was mostly learnt from the data."
    shown = [symbol(name) for name in assumed]
    if len(shown) > _MOST_NAMED + 1:
        shown = [*shown[:_MOST_NAMED], f"{len(shown) - _MOST_NAMED} more"]
    little = (
        f"about {shown[0]} the data say little: it is mostly assumed, and drawn to nominal"
        if len(shown) == 1
        else f"about each of {listed(shown)} alone the data say little: they are mostly assumed, and drawn to nominal"
    )
    return f"Of {free_parameters(names)} {len(names) - len(assumed)} were mostly learnt from the data; {little}."
