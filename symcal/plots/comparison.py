"""Calibrations of one robot beside each other: differences of parameters, errors, how far tools are apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from symcal.plots.panels import logarithmic
from symcal.plots.style import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    LOOKS,
    ORANGE,
    PURPLE,
    RULE,
    VERMILION,
    WIDE,
    Illustration,
    escaped,
    grid,
    marks,
    print_settings,
    settle,
    sheet,
)
from symcal.report.comparison import changed
from symcal.units import in_mrad
from symcal.words import is_term_number, listed, number, p_value, plural, symbol

Content = Mapping[str, Any]

_RUNS = ((BLUE, "o"), (ORANGE, "s"), (GREEN, "^"), (PURPLE, "D"), (INK, "v"), ("#56B4E9", "P"), (FAINT, "X"))
_IN_ROW = 30  # parameters
_NAME = 26  # letters of a run's name that fit beside an axis
_ROW_MM, _LINE_MM = 50.0, 5.5
_SPREAD = 0.56  # of the distance between parameters, for the marks of several runs


def comparison(content: Content) -> Illustration:
    """Differences of every run to the first by parameter, and what runs and differences come to.

    Upper rows: difference with its 95 % interval for one robot measured twice, by unit; filled where it is beyond the
    joint uncertainty at a simultaneous level. Below: error of each run before and after; how far tools are apart beside
    what is expected of one robot.

    Args:
        content: of results.json of a comparison.
    """
    pairs = content["comparison"]
    rows = _rows(pairs)
    below = 18 + _LINE_MM * max(len(content["runs"]), len(pairs) + 1)
    with print_settings():
        figure = sheet(WIDE, 8 + _ROW_MM * len(rows) + below)
        parts = figure.subfigures(len(rows) + 1, 1, squeeze=False, height_ratios=[_ROW_MM] * len(rows) + [below])[:, 0]
        for part, row in zip(parts, rows, strict=False):
            ratios = [len(names) + 2 for _, names in row]
            for axes, panel in zip(part.subplots(1, len(row), width_ratios=ratios, squeeze=False)[0], row, strict=True):
                _differences(axes, *panel, pairs)
        left, right = parts[-1].subplots(1, 2)
        _errors(left, content["runs"])
        _tools(right, pairs)
        _legend(figure, pairs)
    title = "Calibrations of one robot compared"
    return Illustration(settle(figure), "compare", title, _caption(content))


def _rows(pairs: Sequence[Content]) -> list[list[tuple[str, list[str]]]]:
    """Rows of panels: unit and names of parameters; links first, angles before lengths, then joint terms."""
    units = {name: each["unit"] for pair in pairs for name, each in pair["parameters"].items()}
    panels: list[tuple[str, list[str]]] = []
    for of_terms in (False, True):
        kinds = dict.fromkeys(["rad", "mm", *units.values()])
        for kind in kinds:
            own = [name for name, unit in units.items() if unit == kind and is_term_number(name) == of_terms]
            panels += [(kind, own[k : k + _IN_ROW]) for k in range(0, len(own), _IN_ROW)]
    rows: list[list[tuple[str, list[str]]]] = []
    for panel in panels:
        if rows and sum(len(names) for _, names in rows[-1]) + len(panel[1]) <= _IN_ROW:
            rows[-1].append(panel)
        else:
            rows.append([panel])
    return rows


def _differences(axes: Axes, kind: str, names: Sequence[str], pairs: Sequence[Content]) -> None:
    label, factor = ("10⁻³", 1e3) if kind == "1" else in_mrad(kind)
    offsets = np.linspace(-0.5, 0.5, len(pairs)) * _SPREAD if len(pairs) > 1 else [0.0]
    size = 4.0 if len(pairs) < 4 else 2.8
    differing = {name for pair in pairs for name in pair["differing"]}
    for pair, offset, (color, marker) in zip(pairs, offsets, _RUNS, strict=False):
        for at, name in enumerate(names):
            each = pair["parameters"].get(name)
            if each is None:
                continue
            judged = each["p"] is not None
            axes.errorbar(
                at + offset,
                factor * each["difference"],
                yerr=factor * each["half_width_95"] if judged else None,
                linestyle="none",
                marker=marker if judged else ".",
                markersize=size if judged else 2.5,
                color=color if judged else FAINT,
                markerfacecolor=color if each["differs"] else "white" if judged else FAINT,
                elinewidth=1.4 if each["differs"] else 0.7,
                zorder=4 if each["differs"] else 3,
            )
    axes.axhline(0, color=INK, linewidth=0.5, zorder=1)
    axes.set_xlim(-0.8, len(names) - 0.2)
    wordy = any(is_term_number(name) for name in names)
    axes.set_xticks(range(len(names)), [escaped(symbol(n)) for n in names], rotation=90 if wordy else 0)
    for tick, name in zip(axes.get_xticklabels(), names, strict=True):
        if name in differing:
            tick.set(color=VERMILION, fontweight="bold")
            axes.axvspan(names.index(name) - 0.45, names.index(name) + 0.45, color=VERMILION, alpha=0.08, linewidth=0)
    axes.tick_params(axis="x", length=0)
    axes.set_ylabel(f"difference / {label}")
    grid(axes)


def _errors(axes: Axes, runs: Content) -> None:
    """Rms errors before and after of every run, the first on top."""
    shown = {name: run["accuracy"] for name, run in runs.items()}
    first = next((found for found in shown.values() if found), None)
    unit = first["unit"] if first else "mm"
    values = []
    for at, found in enumerate(shown.values()):
        if found and found["unit"] == unit:
            before, after = (found[state]["rms"] for state in ("before", "after"))
            axes.plot([before, after], [at, at], color=RULE, linewidth=2.2, solid_capstyle="butt", zorder=1)
            axes.plot(after, at, markersize=4.5, zorder=3, **marks(LOOKS["after"]))
            axes.plot(before, at, markersize=4.5, zorder=3, **marks(LOOKS["before"]))
            values += [before, after]
        else:
            axes.annotate("not recorded", (0.02, at), xycoords=("axes fraction", "data"), va="center", color=FAINT)
    _lines(axes, list(shown))
    if values and min(values) > 0:
        axes.set_xscale("log")
        axes.set_xlim(min(values) / 1.6, max(values) * 1.6)
        logarithmic(axes.xaxis)
    axes.set_xlabel(f"rms error before (hollow) and after / {unit}")


def _tools(axes: Axes, pairs: Sequence[Content]) -> None:
    """How far tools are apart, beside what is expected of one robot."""
    for at, (pair, (color, marker)) in enumerate(zip(pairs, _RUNS, strict=False)):
        tool = pair["tool_mm"]
        axes.barh(at, tool["expected_rms"], height=0.62, color=RULE, zorder=1)
        axes.plot([tool["rms"], tool["max"]], [at, at], color=color, linewidth=0.8, zorder=2)
        axes.plot(tool["max"], at, marker="|", color=color, markersize=6, zorder=2)
        face = color if changed(pair) else "white"
        axes.plot(tool["rms"], at, marker=marker, color=color, markerfacecolor=face, markersize=4.5, zorder=3)
    _lines(axes, [pair["second"] for pair in pairs])
    axes.set_xlim(left=0)
    axes.set_xlabel("tool apart: rms to largest, grey: expected / mm")


def _lines(axes: Axes, names: Sequence[str]) -> None:
    """One line for each run, from the top."""
    axes.set_yticks(range(len(names)), [escaped(_short(name)) for name in names])
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    grid(axes, "x")


def _short(name: str) -> str:
    return name if len(name) <= _NAME else f"…{name[1 - _NAME :]}"


def _legend(figure: Figure, pairs: Sequence[Content]) -> None:
    handles = [
        Line2D([], [], color=color, marker=marker, markerfacecolor="white", linewidth=0.8, label=escaped(label))
        for pair, (color, marker) in zip(pairs, _RUNS, strict=False)
        for label in [f"{_short(pair['second'])} − {_short(pair['first'])}"]
    ]
    if any(pair["differing"] for pair in pairs):
        handles.append(
            Line2D([], [], color=INK, marker="o", linewidth=1.4, label="filled: beyond the joint uncertainty")
        )
    if any(each["p"] is None for pair in pairs for each in pair["parameters"].values()):
        handles.append(Line2D([], [], color=FAINT, marker=".", linewidth=0, label="not told by both"))
    figure.legend(handles=handles, loc="outside upper center", ncols=min(len(handles), 4))


def _caption(content: Content) -> str:
    pairs = content["comparison"]
    judged = sum(each["p"] is not None for each in pairs[0]["parameters"].values())
    out = (
        f"Differences of identified parameters to {pairs[0]['first']}, with the 95 % interval that two calibrations of "
        "one robot leave; what one of the two does not tell is a grey dot. "
    )
    for pair in pairs:
        named = [symbol(name) for name in pair["differing"][:6]]
        more = len(pair["differing"]) - len(named)
        if pair["identical"]:
            said = "is the same calibration"
        elif named:
            shown = listed([*named, f"{more} more"] if more else named)
            said = f"differs in {shown} (of {judged} parameters that both tell; joint {p_value(pair['p'])})"
        elif changed(pair):
            said = f"differs, though no single parameter can be named (joint {p_value(pair['p'])})"
        else:
            said = (
                f"differs by no more than its uncertainty (joint {p_value(pair['p'])}, "
                f"{plural(pair['directions'], 'direction')})"
            )
        tool = pair["tool_mm"]
        out += (
            f"{pair['second']} {said}; tools apart by {number(tool['rms'])} mm rms, "
            f"{number(tool['expected_rms'])} expected. "
        )
    return out.strip()
