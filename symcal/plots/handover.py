"""What compensation makes of the errors: how they are distributed, and where in the working area they are."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from numpy.typing import NDArray

from symcal.calibration.compensation_check import Handover
from symcal.calibration.evaluate import statistics
from symcal.plots.cells import draw_cells, from_side, in_cells
from symcal.plots.panels import logarithmic
from symcal.plots.style import (
    LOOKS,
    NARROW,
    VERMILION,
    WIDE,
    Drawing,
    FigureLook,
    Illustration,
    drawing,
    grid,
    print_settings,
    settle,
    sheet,
)
from symcal.words import number, plural

Array = NDArray[np.float64]

_STATES = {
    "before": FigureLook("commands as planned", LOOKS["before"].color, "o", "--", True),
    "after": FigureLook("compensated", LOOKS["after"].color, "o", "-", False),
}
_CELLS = 36  # along the longer side of the area
_MAP, _MARGIN = 58.0, 13.0  # width that a view has for itself, height of labels and title, mm


def handover_drawings(handover: Handover) -> tuple[Drawing, ...]:
    """The distribution of the errors with and without compensation, and where they are; still to be drawn."""
    return drawing(compensation, handover), drawing(compensation_map, handover)


def handover_figures(handover: Handover) -> tuple[Illustration, ...]:
    """Those of `handover_drawings`, drawn."""
    return compensation(handover), compensation_map(handover)


def compensation(handover: Handover) -> Illustration:
    """Cumulative distribution of the position errors against truth, as planned and compensated."""
    norms = {"before": np.sort(handover.before.size), "after": np.sort(handover.after.size)}
    least = 0.5 * max(float(np.percentile(norms["after"], 1)), 1e-12)
    share = 100 * (np.arange(len(handover.wanted)) + 0.5) / len(handover.wanted)
    with print_settings():
        figure = sheet(NARROW, 62)
        axes = figure.subplots()
        for state, values in norms.items():
            look = _STATES[state]
            axes.plot(np.maximum(values, least), share, look.line, color=look.color, linewidth=1.3, label=look.label)
        axes.set_xscale("log")
        axes.set(xlim=(least, 1.3 * max(float(v[-1]) for v in norms.values())), ylim=(0, 101))
        axes.set(xlabel="position error against truth / mm", ylabel="poses below / %")
        logarithmic(axes.xaxis)
        grid(axes, "both")
        figure.legend(loc="outside upper center", ncols=2, handlelength=2.6)
    return Illustration(settle(figure), "compensation", "Compensation", _distribution_caption(handover))


def compensation_map(handover: Handover) -> Illustration:
    """Position error by place of the tool: as planned in the upper row, compensated below, one scale for both."""
    wanted, reached = handover.wanted, handover.reached
    views = (
        ("from above", "x / mm", "y / mm", wanted[:, :2]),
        ("from the side", "distance from the z axis / mm", "z / mm", from_side(wanted, np.zeros(3))),
    )
    spans = [np.ptp(flat, axis=0) for *_, flat in views]
    cell = max(float(span.max()) for span in spans) / _CELLS
    rows = (("before", np.full(len(wanted), True)), ("after", reached))
    maps = [[in_cells(flat, _norms(handover, state), cell, where=where) for *_, flat in views] for state, where in rows]
    values = np.concatenate([found[np.isfinite(found)] for row in maps for found, _, _ in row])
    scale = LogNorm(*_decades(values))
    width = [float(span[0]) for span in spans]
    drawn = 2 * _MAP / sum(width)
    with print_settings():
        height = 2 * max(float(span[1]) for span in spans) * drawn + 2 * _MARGIN
        figure = sheet(WIDE, float(np.clip(height, 70.0, 150.0)))
        panels: Any = figure.subplots(2, 2, width_ratios=width)
        for i, (state, _) in enumerate(rows):
            for j, (title, right, up, flat) in enumerate(views):
                axes = panels[i, j]
                shown = draw_cells(axes, maps[i][j], scale)
                if state == "after" and not reached.all():
                    axes.plot(*flat[~reached].T, "x", color=VERMILION, markersize=2.2, markeredgewidth=0.5)
                axes.set(xlabel=right if i else "", ylabel=up)
                axes.set_title(title if j else f"{_STATES[state].label}, {title}")
        bar = figure.colorbar(shown, ax=panels, pad=0.015, aspect=36)
        bar.set_label("largest position error in a cell / mm")
        logarithmic(bar.ax.yaxis)
        bar.outline.set_visible(False)
    return Illustration(
        settle(figure), "compensation_map", "Compensation over the working area", _map_caption(handover)
    )


def _norms(handover: Handover, state: str) -> Array:
    return (handover.before if state == "before" else handover.after).size


def _decades(values: Array) -> tuple[float, float]:
    """Ends of a logarithmic scale; no error at all would have none."""
    top = max(float(values.max()), 1e-12)
    return max(float(values.min()), 1e-9 * top), top * 1.0001


def _distribution_caption(handover: Handover) -> str:
    before, after = statistics(handover.before.size), statistics(handover.after.size)
    away = int((~handover.reached).sum())
    text = (
        f"Where the tool of the true robot is at {plural(len(handover.wanted), 'random pose')} of the working area, "
        f"less where it was meant to be. With the commands as planned the error is {number(before.mean)} mm on average "
        f"and {number(before.max)} mm at most, compensated with the calibrated model {number(after.mean)} mm and "
        f"{number(after.max)} mm; 95 % of the poses are then below {number(after.p95)} mm."
    )
    if away:
        text += (
            f" The tail on the right is {plural(away, 'pose')} at joint limits or caps, which keep the correction away."
        )
    return text


def _map_caption(handover: Handover) -> str:
    reached = handover.reached
    if not reached.any():
        return "Largest position error of all poses whose tool is in a cell. No pose could be compensated fully."
    inside = statistics(handover.after.size[reached])
    away = len(reached) - inside.count
    text = (
        "Largest position error against truth of all poses whose tool is in a cell, with the commands as planned "
        f"(above) and compensated (below). Where nothing keeps a correction away, {number(inside.rms)} mm rms and "
        f"{number(inside.max)} mm at most are left: what the identification does not know."
    )
    if away:
        text += f" Crosses, not in the cells below: {plural(away, 'pose')} that could not be compensated fully."
    return text
