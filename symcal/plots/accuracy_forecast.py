"""How accurate so many poses make the robot."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator
from numpy.typing import NDArray

from symcal.planning.accuracy_forecast.forecast import Forecast
from symcal.planning.accuracy_forecast.random_band import HIGH, LOW, RandomBand
from symcal.planning.plan_study import PlanStudy
from symcal.plots.style import BLUE, FAINT, INK, ORANGE, WIDE, Illustration, grid, print_settings, settle, sheet
from symcal.words import number, plural

Array = NDArray[np.float64]


def error_by_poses(found: PlanStudy, promise: Forecast, band: RandomBand) -> Illustration:
    """Predicted errors of the best and of random plans over the number of poses, with the bound of any plan."""
    counts = np.array(promise.counts)
    n = len(found.planned.plan)
    foretold = found.planned.plan.prediction
    with print_settings():
        figure = sheet(WIDE, 66)
        left, right = figure.subplots(1, 2, sharey=True)
        left.fill_between(counts, _drawn(band.low_mm), _drawn(band.high_mm), color=ORANGE, alpha=0.22, linewidth=0)
        _curves(
            left,
            counts,
            promise.best_mean_mm,
            promise.random_mean_mm,
            promise.bound_mean_mm,
            n,
            foretold.mean_pose_rms_mm,
        )
        _curves(
            right,
            counts,
            promise.best_worst_mm,
            promise.random_worst_mm,
            promise.bound_worst_mm,
            n,
            foretold.worst_pose_rms_mm,
        )
        left.set_title("rms over the region")
        right.set_title("at the worst pose")
        lowest = min(min(promise.bound_mean_mm), min(promise.bound_worst_mm))
        largest = [v for v in (*promise.random_worst_mm, *band.high_mm) if np.isfinite(v)]
        top = min(max(largest, default=10 * lowest), 30 * max(promise.best_worst_mm))
        left.set_ylim(0.85 * lowest, 1.1 * max(top, max(promise.best_worst_mm)))
        for row, entry in enumerate(sorted(found.needed, key=lambda e: -e.count)):
            axes = left if entry.figure == "mean" else right
            _target(axes, entry.target_mm, entry.count, counts, row)
        left.set_ylabel("predicted rms position error / mm")
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=5)
    return Illustration(settle(figure), "error_by_poses", "How many poses", _caption(found, promise, band))


def _drawn(values: tuple[float, ...]) -> Array:
    return np.asarray(np.minimum(np.array(values), 1e6))


def _curves(axes: Axes, counts: Any, best: Any, random: Any, bound: Any, n: int, own: float) -> None:
    axes.plot(
        counts,
        np.where(np.isfinite(random), random, np.nan),
        color=ORANGE,
        linestyle="--",
        marker="s",
        markersize=2.6,
        markerfacecolor="white",
        label="random plans (median, 5 % to 95 %)",
    )
    axes.plot(counts, best, color=BLUE, marker="o", markersize=2.8, label="best plan found")
    axes.plot(counts, bound, color=INK, linewidth=0.8, linestyle=":", label="no plan is below")
    axes.plot(
        n, own, linestyle="none", marker="o", markersize=6.5, markerfacecolor="none", color=BLUE, label="this plan"
    )
    axes.set(xscale="log", yscale="log", xlabel="number of poses")
    axes.set_xlim(0.9 * counts[0], 1.1 * counts[-1])
    axes.xaxis.set_major_locator(FixedLocator(_ticks(counts)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(FixedLocator([d * 10.0**e for e in range(-6, 5) for d in (1, 2, 5)]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_locator(NullLocator())
    grid(axes, "both")


def _ticks(counts: Any) -> list[int]:
    """Round numbers within the counts."""
    low, high = int(counts[0]), int(counts[-1])
    round_ones = [d * 10**e for e in range(4) for d in (1, 2, 3, 5)]
    inside = [v for v in round_ones if low <= v <= high]
    return inside if len(inside) > 2 else [low, high]


def _target(axes: Axes, target: float, count: int, counts: Any, row: int) -> None:
    axes.plot([counts[0] * 0.9, count, count], [target, target, 1e-9], color=FAINT, linewidth=0.8, zorder=1)
    axes.annotate(
        f"{plural(count, 'pose')} for {target:g} mm",
        (count, 0),
        xycoords=("data", "axes fraction"),
        xytext=(3, 3 + 8 * row),
        textcoords="offset points",
        fontsize=6,
        va="bottom",
        ha="left",
        color=INK,
    )


def _caption(found: PlanStudy, promise: Forecast, band: RandomBand) -> str:
    n = len(found.planned.plan)
    i = promise.counts.index(n) if n in promise.counts else len(promise.counts) - 1
    count = promise.counts[i]
    text = (
        "Predicted error of the tool after an identification against the number of poses; the shaded band "
        f"holds {100 * (HIGH - LOW):.0f} % of {band.plans} random plans of each size, the dotted line is a bound that "
        f"no plan is below. With {plural(count, 'pose')}: {number(promise.best_mean_mm[i])} mm rms over the region "
        f"(bound {number(promise.bound_mean_mm[i])} mm, random {number(promise.random_mean_mm[i])} mm) and "
        f"{number(promise.best_worst_mm[i])} mm at the worst pose (bound {number(promise.bound_worst_mm[i])} mm, "
        f"random {number(promise.random_worst_mm[i])} mm)."
    )
    for entry in found.needed:
        figure = "rms" if entry.figure == "mean" else "at the worst pose"
        text += f" For {entry.target_mm:g} mm {figure}: {plural(entry.count, 'pose')}, at least {entry.at_least}."
    return text
