"""The page of a study: what one of its plans identified, to touch, and what the study says about it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from symcal.outputs.whole_file import write_whole
from symcal.page.assembled import assembled
from symcal.page.identification import Identified, touchable
from symcal.report.decision import as_sentence, warnings_beside
from symcal.report.identification import identifiability_text
from symcal.report.parameter_table import parameter_table
from symcal.report.render import Picture

Text = Mapping[str, Any]
Pieces = list[tuple[str, str | None]]

_REFERENCE = re.compile(r"\[@([a-z0-9_]+)\]")
_COMPENSATION = ("compensation", "compensation_map")
_FIRST = "The paper's results and ours"


def write_study_page(found: Identified, text: Text, path: Path | str) -> None:
    """Write the page as one file that asks for nothing else.

    Args:
        text: of the study's report: title, verdict and blocks.
    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, study_page(found, text))


def study_page(found: Identified, text: Text) -> str:
    """The page as HTML."""
    return assembled("study", partial(_given, found, text), found.pictures, found.images)


def _given(found: Identified, text: Text) -> dict[str, Any]:
    """What the template shows, but for figures and images."""
    content = found.content
    identified = {
        "warnings": [as_sentence(warning) for warning in warnings_beside(content)],
        "parameters": parameter_table(content["identification"]["parameters"]),
        "identifiability": identifiability_text(content),
        "frames": None,
        "known": None,
    }
    sections = sections_of(text["blocks"])
    shown = [name for section in sections for block in section["blocks"] for name in block.get("names", ())]
    return touchable(found) | {
        "text": dict(text) | identified,
        "sections": sections,
        "placed": [*shown, *_COMPENSATION],
        "numbers": numbers_of(text["blocks"], found.pictures),
    }


def sections_of(blocks: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Blocks below the headings that they are under, their running text in pieces; the first ones have none of
    their own."""
    sections: list[dict[str, Any]] = [{"id": "study", "title": _FIRST, "blocks": []}]
    for block in blocks:
        if block["kind"] == "heading":
            sections.append({"id": f"study-{len(sections)}", "title": block["text"], "blocks": []})
        else:
            sections[-1]["blocks"].append(_in_pieces(block))
    return [section for section in sections if section["blocks"]]


def numbers_of(blocks: Iterable[Mapping[str, Any]], pictures: Sequence[Picture]) -> dict[str, str]:
    """What tables and figures are called, by name: `table 2`."""
    drawn = {picture.name for picture in pictures}
    tables, figures = [], []
    for block in blocks:
        if block["kind"] == "table":
            tables.append(block["name"])
        names = _COMPENSATION if block["kind"] == "handover" else block.get("names", ())
        figures += [name for name in names if name in drawn]
    kinds = {"table": tables, "figure": figures}
    return {name: f"{kind} {i}" for kind, names in kinds.items() for i, name in enumerate(names, start=1)}


def _in_pieces(block: Mapping[str, Any]) -> dict[str, Any]:
    found = dict(block)
    if block["kind"] == "text":
        found["text"] = pieces(block["text"])
    if block["kind"] == "list":
        found["items"] = [[lead, pieces(words)] for lead, words in block["items"]]
    if block["kind"] == "table":
        found["caption"] = pieces(block["caption"])
        found["rows"] = [row | {"cells": [pieces(cell) for cell in row["cells"]]} for row in block["rows"]]
    return found


def pieces(text: str) -> Pieces:
    """Words, and names of what they refer to, in their order: `see [@table_5].`."""
    parts = _REFERENCE.split(text)
    return [("", part) if i % 2 else (part, None) for i, part in enumerate(parts) if i % 2 or part]
