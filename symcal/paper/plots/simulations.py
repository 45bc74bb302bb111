"""The paper's Fig. 7 and 9: convergence without noise, and the error at every test point with it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.paper import published
from symcal.paper.plots.looks import PLANS
from symcal.paper.results import PLAN_NAMES, Study
from symcal.plots.style import FAINT, INK, LOOKS, NARROW, WIDE, Illustration, grid, marks, print_settings, settle, sheet
from symcal.words import number, plural

Array = NDArray[np.float64]

GOAL = 1e-10
"""Position error at which the paper stops, mm."""


def convergence(study: Study) -> Illustration:
    """Mean position error over the training poses against the step, on every plan."""
    first = study.simulation_1
    with print_settings():
        figure = sheet(NARROW, 62)
        axes = figure.add_subplot()
        for name in PLAN_NAMES:
            look, errors = PLANS[name], np.maximum(first.plans[name].position_error_mm, 1e-14)
            axes.plot(
                np.arange(len(errors)),
                errors,
                color=look.color,
                linestyle=look.line,
                marker=look.marker,
                markersize=2.4,
                markerfacecolor="white" if look.hollow else look.color,
                label=look.label,
            )
        axes.axhline(GOAL, color=INK, linewidth=0.6, linestyle=":")
        axes.axvline(published.SIMULATION_1_ITERATIONS, color=FAINT, linewidth=0.8)
        axes.text(
            published.SIMULATION_1_ITERATIONS - 0.3,
            3e-9,
            "the paper's end",
            rotation=90,
            ha="right",
            va="center",
            color=FAINT,
            fontsize=6.5,
        )
        axes.set_yscale("log")
        axes.set(xlabel="step", ylabel="mean position error / mm", xlim=(-0.5, published.SIMULATION_1_ITERATIONS + 1.5))
        grid(axes)
        axes.legend(loc="upper right", bbox_to_anchor=(0.93, 1.0))
    counts = first.draws[:, 0]
    more = (
        f" On {plural(len(counts), 'random plan')} it takes {int(counts.min())} to {int(counts.max())} steps."
        if len(counts)
        else ""
    )
    caption = (
        f"Simulation I, without noise, from {first.main.position_error_mm[0]:.3g} mm: below 10⁻¹⁰ mm (dotted) after "
        f"{first.main.iterations} steps on the plan by the paper's fitness; the paper takes "
        f"{published.SIMULATION_1_ITERATIONS}.{more}"
    )
    return Illustration(settle(figure), "paper_convergence", "Convergence (paper: Fig. 7)", caption)


def test_errors(study: Study, names: tuple[str, str, str]) -> Illustration:
    """The error of every test point before and after, against noisy measurement and against truth."""
    found = {name: study.simulation_2[name] for name in names}
    panels = {
        "a  against noisy measurement": (
            found[names[0]].before_measured,
            {n: f.after_measured for n, f in found.items()},
        ),
        "b  against truth": (study.setting.before_raw, {n: f.after_true for n, f in found.items()}),
    }
    with print_settings():
        figure = sheet(WIDE, 64)
        both: Any = figure.subplots(1, 2, sharey=True)
        for axes, (title, (before, after)) in zip(both, panels.items(), strict=True):
            x = np.arange(1, len(before) + 1)
            axes.plot(x, before, **marks(LOOKS["before_raw"]) | {"markersize": 1.6}, label="uncalibrated", zorder=2)
            for name, errors in after.items():
                look = PLANS[name]
                axes.plot(x, errors, **marks(look) | {"markersize": 1.5, "markeredgewidth": 0.35}, label=look.label)
                axes.axhline(errors.mean(), color=look.color, linestyle=look.line, linewidth=1.1, zorder=5)
            axes.set_yscale("log")
            axes.set_ylim(1e-3, 20)
            axes.set_xlim(0, len(before) + 1)
            axes.set(title=title, xlabel="test point")
            grid(axes)
        both[0].set_ylabel("position error / mm")
        handles, labels = both[0].get_legend_handles_labels()
        legend = figure.legend(handles, labels, loc="outside upper center", ncols=4)
        for handle in legend.legend_handles:
            handle.set_markersize(4)  # type: ignore[union-attr]
            handle.set_markeredgewidth(0.7)  # type: ignore[union-attr]
    means = "; ".join(
        f"{PLANS[n].label} {number(float(f.after_measured.mean()))} and {number(float(f.after_true.mean()))}"
        for n, f in found.items()
    )
    caption = (
        f"One draw of the noise; lines are means. Mean against noisy measurement and against truth, mm: {means}. The "
        "same identifications in both panels: what is measured with noise hides most of the difference between plans."
    )
    return Illustration(settle(figure), "paper_test_errors", "Error at every test point (paper: Fig. 9)", caption)
