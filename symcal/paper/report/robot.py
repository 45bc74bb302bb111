"""The robot and how it is measured: Tables I and II, Fig. 3."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symcal.paper import published
from symcal.paper.report.blocks import Block, Row, figures, heading, paragraph, row, table
from symcal.parameters import link_name
from symcal.words import fixed, listed, number, plural, symbol

Content = Mapping[str, Any]

_KINDS = ("theta", "alpha", "a", "d", "beta")
_ABSENT = "×"


def robot(content: Content) -> list[Block]:
    """Model, ranges, vision set-up."""
    rows, differing = _table_1(content)
    position, links = content["nominal_pose"]["position_mm"], content["model"]["links"]
    agree = (
        "Every entry is the paper's."
        if not differing
        else f"All entries but {listed(differing)} are the paper's; where ours differ both are given."
    )
    return [
        heading("The robot and its measurement"),
        paragraph(
            f"The robot has {plural(len(links), 'joint')} ({listed([link['joint'] for link in links])}); each link is "
            "one transform T = Rz(θ) Tz(d) Tx(a) Rx(α) Ry(β) from the frame before to its own (the paper's MDH: "
            "distal, with Hayati's β where neighbouring axes are parallel). A link has only the parameters that its "
            "transform contains. The position of the last origin is measured; at the initial pose the nominal robot "
            f"has it at ({', '.join(fixed(v, 3) for v in position)}) mm. The paper's Fig. 1 and Fig. 2 show the "
            "machine and its frames; the numbers of both are in [@table_1]."
        ),
        table(
            "table_1",
            "Nominal parameters (paper: Table I)",
            f"× is not in the link's transform. {agree} α₅ and a turn of the last frame do not move its origin; the "
            "paper lists α₅ here and not among the error parameters of its Table III.",
            ["link", "joint", "θ / °", "α / °", "a / mm", "d / mm", "β / °"],
            rows,
            left=(0, 1),
            wide=(1, 2, 3, 4, 5, 6),
        ),
        table(
            "table_2",
            "Ranges of the joints (paper: Table II)",
            "The working area is the part of the ranges that poses, test data and predictions are taken from: the "
            "paper's ‘former half of the whole workspace’ is ours to make precise.",
            ["joint", "variable", "paper", "ours", "working area (ours)"],
            _table_2(content),
            left=(0, 1),
            wide=(0, 1, 2, 3, 4),
        ),
        figures("paper_vision"),
    ]


def _table_1(content: Content) -> tuple[list[Row], list[str]]:
    rows, differing = [], []
    links = content["model"]["links"]
    for i, link in enumerate(links, start=1):
        printed = published.TABLE_I[i - 1] if len(links) == len(published.TABLE_I) else {}
        cells = []
        for kind in _KINDS:
            theirs, ours = printed.get(kind), link["parameters"].get(kind)
            variable = kind == ("theta" if link["kind"] == "revolute" else "d")
            text = (
                _ABSENT if ours is None else symbol(link_name(kind, i)) if variable and ours == 0 else number(ours, 4)
            )
            same = ours is None if theirs is None else ours == (0.0 if isinstance(theirs, str) else theirs)
            if not same:
                differing.append(symbol(link_name(kind, i)))
                text += (
                    f" (paper: {_ABSENT if theirs is None else theirs if isinstance(theirs, str) else number(theirs)})"
                )
            cells.append(_plain(text))
        rows.append(row(str(i), link["joint"], *cells))
    return rows, differing


def _plain(text: str) -> str:
    """Whole numbers without decimals."""
    return text.removesuffix(".00").removesuffix(".0")


def _table_2(content: Content) -> list[Row]:
    rows = []
    ranges = content["model"]["ranges"]
    for i, entry in enumerate(ranges, start=1):
        printed = published.TABLE_II[i - 1] if len(ranges) == len(published.TABLE_II) else None
        kind, unit = ("theta", "°") if entry["unit"] == "deg" else ("d", "mm")
        cells = [
            "–" if printed is None else _range(printed),
            _range(entry["limits"]),
            _range(entry["area"]),
        ]
        rows.append(row(entry["joint"], f"{symbol(link_name(kind, i))} / {unit}", *cells))
    return rows


def _range(ends: Any) -> str:
    return " to ".join(fixed(float(v), 0) for v in ends)
