"""One short table, with units, and every name escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

MOST = 40
"""Rows that are shown; the others are counted."""


def html_table(
    title: str, head: Sequence[str], rows: Iterable[Sequence[str]], notes: Iterable[str] = (), drawing: str = ""
) -> str:
    """A caption, a table and lines below it. All of it is text: what looks like markup is shown as it is.

    Args:
        drawing: shown below, as `symcal.notebook.drawing` makes it.
    """
    body = list(rows)
    notes = list(notes)
    if len(body) > MOST:
        notes.insert(0, f"and {len(body) - MOST} more rows")
    parts = [f"<table><caption>{escape(title)}</caption>", _row("th", head)]
    parts += [_row("td", cells) for cells in body[:MOST]]
    parts.append("</table>")
    parts += [f"<p>{escape(note)}</p>" for note in notes]
    parts.append(drawing)
    return "".join(parts)


def _row(tag: str, cells: Sequence[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(str(cell))}</{tag}>' for cell in cells)}</tr>"
