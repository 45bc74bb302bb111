"""The curves of growth as one figure."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

from matplotlib.ticker import LogLocator, NullFormatter

from symcal.bench.tables import duration
from symcal.plots.style import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    VERMILION,
    WIDE,
    Illustration,
    grid,
    print_settings,
    settle,
    sheet,
)

_LOOKS: tuple[tuple[str, Any, str], ...] = (
    (BLUE, "-", "o"),
    (VERMILION, (0, (5, 1.5)), "s"),
    (GREEN, (0, (3, 1.2)), "^"),
    (ORANGE, (0, (5, 1, 1, 1)), "D"),
    (PURPLE, (0, (1.5, 1)), "v"),
    (INK, ":", "x"),
)
"""Told apart by colour, by line and by marker."""

_ACROSS = 3
_TITLE = 34  # letters in a line above a panel
_NARROW = 2.0  # decades of a size within which its values themselves are the ticks


def growth_figure(panels: Sequence[dict[str, Any]]) -> Illustration:
    """Time of one call over its size, both logarithmic, with the line of strictly proportional growth behind."""
    names = list(dict.fromkeys(curve["name"] for panel in panels for curve in panel["curves"]))
    looks = {name: _LOOKS[i % len(_LOOKS)] for i, name in enumerate(names)}
    down = -(-len(panels) // _ACROSS)
    with print_settings():
        figure = sheet(WIDE, 14 + 52 * down)
        grids = figure.subplots(down, _ACROSS, squeeze=False).ravel()
        labels: dict[str, Any] = {}
        for axes, panel in zip(grids, panels, strict=False):
            for curve in panel["curves"]:
                color, line, marker = looks[curve["name"]]
                (labels[curve["name"]],) = axes.plot(
                    curve["sizes"],
                    curve["seconds"],
                    color=color,
                    linestyle=line,
                    marker=marker,
                    markerfacecolor=color if marker == "o" else "white",
                    label=curve["name"],
                )
            axes.set(xscale="log", yscale="log", title="\n".join(wrap(panel["name"], _TITLE)), xlabel=panel["variable"])
            _proportional(axes, panel)
            axes.yaxis.set_major_locator(LogLocator(numticks=6))
            axes.yaxis.set_major_formatter(lambda value, _: duration(value))
            axes.yaxis.set_minor_formatter(NullFormatter())
            _size_ticks(axes, panel)
            grid(axes, "both")
        for axes in grids[len(panels) :]:
            axes.set_axis_off()
        figure.legend(list(labels.values()), list(labels), loc="outside upper center", ncols=min(len(labels), 4))
    return Illustration(settle(figure), "growth", "Growth", _caption(panels))


def _proportional(axes: Any, panel: dict[str, Any]) -> None:
    """Twice the size, twice the time: through the last point of the first curve."""
    first = panel["curves"][0]
    last, seconds = first["sizes"][-1], first["seconds"][-1]
    low, high = axes.get_ylim()
    axes.plot([last * 1e-6, last], [seconds * 1e-6, seconds], color="#d0d0d0", linewidth=0.8, zorder=0)
    sizes = [size for curve in panel["curves"] for size in curve["sizes"]]
    axes.set_xlim(min(sizes) / 1.3, max(sizes) * 1.3)
    axes.set_ylim(low, high)


def _size_ticks(axes: Any, panel: dict[str, Any]) -> None:
    sizes = sorted({size for curve in panel["curves"] for size in curve["sizes"]})
    if sizes[-1] < sizes[0] * 10**_NARROW:
        axes.set_xticks(sizes, [str(size) for size in sizes])
        axes.xaxis.set_minor_locator(LogLocator(numticks=1))
        axes.xaxis.set_minor_formatter(NullFormatter())


def _caption(panels: Sequence[dict[str, Any]]) -> str:
    ours = [
        f"{panel['name']} with {panel['variable']} {panel['curves'][0]['power']:.2f}"
        for panel in panels
        if panel["curves"][0]["power"] is not None
    ]
    return (
        "Processor time of one call over its size; grey: proportional growth. Power of the size that the time of "
        f"symcal follows at the largest sizes: {'; '.join(ours)}."
    )
