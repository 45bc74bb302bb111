"""What one draw cannot show: distributions over many repetitions."""

from __future__ import annotations

import numpy as np

from symcal.paper import published
from symcal.paper.plots.looks import PLANS
from symcal.paper.repetitions import NEW_RANDOM
from symcal.paper.results import Study
from symcal.paper.surroundings import mean_norm
from symcal.plots.style import INK, NARROW, Illustration, grid, print_settings, settle, sheet
from symcal.words import number


def true_errors(study: Study) -> Illustration:
    """The rms error against truth in every repetition, as cumulative shares, with each plan's lower bound."""
    repeated = study.repetitions
    with print_settings():
        figure = sheet(NARROW, 66)
        axes = figure.add_subplot()
        share = 100 * (np.arange(repeated.count) + 0.5) / repeated.count
        step = max(repeated.count // 250, 1)
        for name in repeated.names:
            look = PLANS[name]
            values = np.sort(repeated.true_rms[name])
            axes.plot(
                values[::step],
                share[::step],
                color=look.color,
                linestyle=look.line,
                marker=look.marker,
                markersize=2.6,
                markerfacecolor="white" if look.hollow else look.color,
                markevery=max(len(values[::step]) // 7, 1),
                label=look.label,
            )
        axes.set_xscale("log")
        axes.set_xlim(0.009, 0.25)
        ticks = [0.01, 0.02, 0.05, 0.1, 0.2]
        axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
        axes.minorticks_off()
        axes.axhline(50, color=INK, linewidth=0.4, linestyle=":")
        axes.set(
            xlabel="rms error against truth over the test poses / mm", ylabel="share of repetitions / %", ylim=(0, 100)
        )
        grid(axes, "both")
        axes.legend(loc="lower right", fontsize=6)
    wins = repeated.wins("certified")
    caption = (
        f"{repeated.count} repetitions with new noise. In the median the certified plan leaves "
        f"{number(float(np.median(repeated.true_rms['certified'])))} mm, a new random plan "
        f"{number(float(np.median(repeated.true_rms[NEW_RANDOM])))} mm, the plan by the paper's fitness "
        f"{number(float(np.median(repeated.true_rms['paper_ga'])))} mm. The certified one wins against a new random "
        f"plan in {number(100 * wins)} % of them: one draw, as in the paper, could go either way."
    )
    return Illustration(settle(figure), "paper_repetitions", "Chance", caption)


def measured_errors(study: Study) -> Illustration:
    """Mean and largest error against noisy test data in every repetition, with the paper's values."""
    repeated = study.repetitions
    names = [name for name in repeated.names if name != "random"]
    floor = study.setting.noise
    with print_settings():
        figure = sheet(NARROW, 66)
        axes = figure.add_subplot()
        for i, name in enumerate(names):
            look = PLANS[name]
            for values, offset, filled in (
                (repeated.measured_mean[name], 0.14, True),
                (repeated.measured_max[name], -0.14, False),
            ):
                low, middle, high = np.percentile(values, [5, 50, 95])
                axes.plot([low, high], [i + offset] * 2, color=look.color, linewidth=1.2, solid_capstyle="butt")
                axes.plot(
                    middle,
                    i + offset,
                    marker="o" if filled else "s",
                    markersize=3.4,
                    color=look.color,
                    markerfacecolor=look.color if filled else "white",
                )
        for key, line in (("optimal", "-"), ("random", "--")):
            for which, words in (("mean_mm", "mean"), ("max_mm", "max")):
                value = published.TABLE_IV[key]["after"][which]
                axes.axvline(value, color=INK, linewidth=0.7, linestyle=line, zorder=1)
                # the random mean and the optimal maximum stand close together
                side, by = ("right", 0.985) if key == "random" else ("left", 1.015)
                axes.text(value * by, len(names) - 0.42, words, fontsize=6, va="bottom", ha=side)
            axes.plot([], [], color=INK, linewidth=0.7, linestyle=line, label=f"paper, {key} trajectory")
        axes.legend(loc="lower center", bbox_to_anchor=(0.35, 1.0), ncols=2)
        axes.set_yticks(
            range(len(names)),
            [PLANS[name].label.replace(" (GA)", "\n(GA)").replace(" plan ", "\nplan ") for name in names],
        )
        axes.set_ylim(-0.6, len(names) - 0.1)
        axes.set_xscale("log")
        ticks = [0.1, 0.15, 0.2, 0.3, 0.4]
        axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
        axes.minorticks_off()
        axes.set_xlim(0.088, 0.55)
        axes.set_xlabel("error against noisy test data / mm")
        grid(axes, "x")
    caption = (
        f"Median and 5 to 95 % of {repeated.count} repetitions: mean over the test points (filled) and largest (open). "
        "Lines: the paper's one draw, optimal (solid) and random (dashed). Noise alone has a mean norm of "
        f"{number(mean_norm(floor))} mm: no mean error can be expected to be smaller."
    )
    return Illustration(settle(figure), "paper_measured", "Against noisy test data", caption)
