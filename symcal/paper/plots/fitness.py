"""The paper's fitness: what its readings lead to, and how the searches went."""

from __future__ import annotations

from typing import Any

import numpy as np

from symcal.paper.plots.looks import PLANS
from symcal.paper.results import Study
from symcal.plots.style import FAINT, INK, RULE, VERMILION, WIDE, Illustration, grid, print_settings, settle, sheet
from symcal.words import number

READING_NAMES = {
    "main": "stacked, camera rows (the config's)",
    "per_pose": "per pose",
    "stacked": "stacked",
    "without_camera": "rows of the position, no camera",
    "unscaled": "columns in rad and mm",
    "whitened": "relative to the area's information",
}


def fitness_readings(study: Study) -> Illustration:
    """Predicted error of the plan that each reading leads to, over the range of random plans."""
    rows = [(READING_NAMES[r.key], r.expected_rms_mm, VERMILION, "s", True) for r in study.readings]
    for name in ("random", "ga", "certified"):
        look = PLANS[name]
        rows.append((look.label, study.plans[name].expected_rms_mm, look.color, look.marker, look.hollow))
    random = study.random.expected_rms_mm
    with print_settings():
        figure = sheet(WIDE, 62)
        left: Any
        right: Any
        left, right = figure.subplots(1, 2, width_ratios=[1.5, 1.0])
        y = np.arange(len(rows))[::-1]
        low, high = float(random.min()), float(random.max())
        left.axvspan(low, high, color=RULE, linewidth=0, zorder=0)
        left.axvline(float(np.median(random)), color=FAINT, linewidth=0.8, linestyle="--")
        left.text(float(np.sqrt(low * high)), len(rows) - 0.35, "random plans", ha="center", fontsize=6.2, color=INK)
        for place, (_, value, color, marker, hollow) in zip(y, rows, strict=True):
            left.plot(
                value,
                place,
                marker=marker,
                color=color,
                markersize=4,
                markerfacecolor="white" if hollow else color,
                linestyle="none",
            )
            left.annotate(
                number(value), (value, place), xytext=(5, 0), textcoords="offset points", va="center", fontsize=6.2
            )
        left.axhline(2.5, color=FAINT, linewidth=0.5)
        left.set_yticks(y, [row[0] for row in rows])
        left.set_ylim(-0.6, len(rows) + 0.2)
        left.set_xscale("log")
        ticks = [0.025, 0.05, 0.1, 0.2]
        left.set_xticks(ticks, [f"{t:g}" for t in ticks])
        left.minorticks_off()
        left.set_xlim(0.022, max(0.26, 1.4 * max(row[1] for row in rows)))
        left.set(xlabel="predicted rms error over the test poses / mm", title="a  what each fitness leads to")
        grid(left, "x")
        _histories(right, study)
    caption = (
        "a: the genetic algorithm's plan by each reading of the paper's fitness (open squares) and our plans below the "
        f"line; grey: all {len(random)} random plans, dashed their median. b: best fitness against the generation, as "
        "its distance from the last value relative to the first."
    )
    return Illustration(settle(figure), "paper_readings", "The paper's fitness", caption)


def _histories(axes: Any, study: Study) -> None:
    for name in ("paper_ga", "ga"):
        history, look = study.plans[name].history, PLANS[name]
        if history is None:
            continue
        usable = np.flatnonzero(np.isfinite(history))
        values = history[usable]
        fall = values[0] - values[-1]
        axes.plot(
            usable,
            (values - values[-1]) / (fall if fall > 0 else 1.0),
            color=look.color,
            linestyle=look.line,
            label=look.label,
        )
    axes.set(xlabel="generation", ylabel="fitness still to gain / 1", title="b  the searches", ylim=(-0.02, 1.02))
    grid(axes)
    axes.legend(loc="upper right")
