"""What the template knows how to set: headings, text, lists, tables and pictures, as plain data.

In any text `[@name]` becomes a reference to the picture or table of that name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from symcal.words import fixed, number

Block = dict[str, Any]
Row = dict[str, Any]


def heading(text: str) -> Block:
    return {"kind": "heading", "text": text}


def paragraph(text: str, lead: str = "") -> Block:
    """Running text; a lead stands in bold before it."""
    return {"kind": "text", "text": text, "lead": lead}


def bullets(items: Sequence[str | tuple[str, str]]) -> Block:
    """A list; an item with a lead is (lead, text)."""
    return {"kind": "list", "items": [["", i] if isinstance(i, str) else list(i) for i in items]}


def figures(*names: str) -> Block:
    return {"kind": "figures", "names": list(names)}


def row(*cells: str, strong: bool = False, faint: bool = False, rule: bool = False) -> Row:
    """A table's row; a rule stands above it."""
    return {"cells": list(cells), "strong": strong, "faint": faint, "rule": rule}


def table(
    name: str,
    title: str,
    caption: str,
    head: Sequence[str],
    rows: Sequence[Row],
    *,
    groups: Sequence[tuple[str, int]] = (),
    wide: Sequence[int] = (0,),
    left: Sequence[int] = (0,),
    floats: bool = False,
) -> Block:
    """A table.

    Args:
        groups: labels with the number of columns that each spans, above the head. wide: columns that take what room is
            left. left: columns that are set flush left.
        floats: may stand at the top or bottom of a page, while text goes on.
    """
    return {
        "kind": "table",
        "name": name,
        "title": title,
        "caption": caption,
        "head": list(head),
        "rows": list(rows),
        "groups": [[label, span] for label, span in groups],
        "wide": list(wide),
        "left": list(left),
        "floats": floats,
    }


def percent(share: float, decimals: int = 1) -> str:
    """A share as a percentage that never rounds to all or nothing when it is not."""
    shown = round(100 * share, decimals)
    if share < 1 and shown >= 100:
        return f"> {fixed(100 - 10.0**-decimals, decimals)} %"
    if share > 0 and shown <= 0:
        return f"< {fixed(10.0**-decimals, decimals)} %"
    return f"{fixed(100 * share, 0 if share in (0, 1) else decimals)} %"


def at_least(share: float) -> str:
    """A lower bound as a percentage, rounded down."""
    return f"≥ {fixed(int(min(share, 0.99999) * 1000) / 10, 1)} %"


def span(quantiles: dict[str, float]) -> str:
    """Median with its 5 to 95 % range, mm."""
    return f"{number(quantiles['median'])} ({number(quantiles['p05'])} to {number(quantiles['p95'])})"


def pair(entry: dict[str, float]) -> str:
    """Mean / max, mm."""
    return f"{number(entry['mean_mm'])} / {number(entry['max_mm'])}"
