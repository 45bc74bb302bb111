"""How good each search method gets, and how soon."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

from symcal.planning.plan_study import PlanStudy
from symcal.planning.results import best_value, efficiency_over_time, has_bound
from symcal.planning.search import Plan
from symcal.plots.style import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    NARROW,
    ORANGE,
    VERMILION,
    Illustration,
    grid,
    print_settings,
    settle,
    sheet,
)
from symcal.words import number

_LOOKS: dict[str, tuple[str, Any, str]] = {
    "certified": (BLUE, "-", "o"),
    "combined": (INK, (0, (5, 1.5)), "v"),
    "exchange": (GREEN, (0, (3, 1.2)), "s"),
    "refine": (ORANGE, (0, (5, 1, 1, 1)), "^"),
    "genetic": (VERMILION, (0, (1.5, 1)), "D"),
    "random": (FAINT, "none", "x"),
}
_SHORTFALLS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
_SMALLEST = 5e-4  # shortfall from 1 that is still told apart


def efficiency_over_search_time(found: PlanStudy) -> Illustration:
    """Efficiency of the best plan so far over wall time for each method; the axis is stretched towards 1."""
    methods = found.methods
    best = best_value(methods)
    with print_settings():
        figure = sheet(NARROW, 66)
        axes = figure.add_subplot()
        lowest, first, last = 0.9, np.inf, 0.0
        for name, plan in methods.items():
            curve = np.array(efficiency_over_time(plan, best))
            if not len(curve):
                continue
            color, line, marker = _LOOKS[name]
            seconds = np.append(curve[:, 0], max(plan.search_seconds, curve[-1, 0]))
            missing = np.maximum(1 - np.append(curve[:, 1], curve[-1, 1]), _SMALLEST)
            axes.step(seconds, missing, where="post", color=color, linestyle=line, linewidth=1.1, zorder=3)
            axes.plot(
                curve[-1, 0],
                missing[-1],
                linestyle="none",
                marker=marker,
                markersize=3.6,
                color=color,
                markerfacecolor="white" if marker != "o" else color,
                label=name,
                zorder=4,
            )
            lowest = min(lowest, float(curve[-1, 1]))
            first, last = min(first, float(seconds[0])), max(last, float(seconds[-1]))
        axes.set(xscale="log", yscale="log")
        axes.set_xlim(0.8 * first, 1.3 * last)
        axes.set_ylim(min(1.15 * (1 - 0.5 * lowest), 1.0), 0.8 * _SMALLEST)
        axes.yaxis.set_major_locator(FixedLocator(list(_SHORTFALLS)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{100 * (1 - v):.4g} %"))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set(xlabel="wall time / s", ylabel=_quantity(found.planned.plan))
        grid(axes, "both")
        figure.legend(loc="outside upper center", ncols=3, handlelength=1.0)
    return Illustration(settle(figure), "search_time", "Search methods", _caption(found))


def _quantity(plan: Plan) -> str:
    if plan.criterion == "D":
        return "D-efficiency, at least"
    return f"efficiency ({plan.criterion}), at least" if has_bound(plan) else f"{plan.criterion} relative to the best"


def _caption(found: PlanStudy) -> str:
    parts = []
    best = best_value(found.methods)
    for name, plan in found.methods.items():
        curve = efficiency_over_time(plan, best)
        if curve:
            reached = min(curve[-1][1], 0.99999)
            parts.append(f"{name} {int(10000 * reached) / 100:.2f} % in {number(plan.search_seconds, 2)} s")
    against = "what any plan can reach" if has_bound(found.planned.plan) else "the best that was found"
    if has_bound(found.planned.plan) and found.problem.choices is not None:
        against = "what any choice from the same postures can reach"
    return (
        f"Efficiency of the best plan so far against {against}, by search method, over wall time on one core; the mark "
        f"is the last improvement. Reached, with the time of search and certificate: {', '.join(parts)}. "
        f"Above {100 * (1 - _SMALLEST):.2f} % the axis ends."
    )
