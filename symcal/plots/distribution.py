"""How the errors are distributed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from symcal.calibration.evaluate import Errors
from symcal.data.dataset import evenly
from symcal.plots.panels import SHOWN, far_apart, legend, logarithmic, opening, quantity
from symcal.plots.style import INK, LOOKS, PARTS, WIDE, Illustration, grid, print_settings, settle, sheet
from symcal.words import listed, number, plural

_BINS = 30
_WORDS = {
    "before_raw": "with nominal numbers and frames",
    "before": "before",
    "offsets_only": "with joint offsets only",
    "after": "after",
}


def error_distribution(
    states: Mapping[str, Errors],
    part: str = "test",
    against: str = "noisy measurement",
    name: str = "error_distribution",
    limit: float | None = None,
) -> Illustration:
    """Histogram and cumulative distribution of the norms of errors, by state.

    Args:
        states: errors by state, of one part of the data. part: which one (`test`, `truth`, ...), for the words.
        name: of the figure's files. limit: the tolerance of such errors, in their unit, where there is one.
    """
    shown = [s for s in ("before_raw", *SHOWN) if s in states]
    norms = {s: np.sort(states[s].size) for s in shown}
    top = max(float(v[-1]) for v in norms.values()) or 1.0
    top = top if limit is None else max(top, 1.05 * limit)
    wide = far_apart(norms)
    bottom = 0.8 * min(float(np.percentile(v, 2)) for v in norms.values()) if wide else 0.0
    bottom = bottom if limit is None else min(bottom, 0.8 * limit)
    wide &= bottom > 0
    edges = np.geomspace(bottom, top, _BINS + 1) if wide else np.linspace(0, top, _BINS + 1)
    with print_settings():
        figure = sheet(WIDE, 58)
        left, right = figure.subplots(1, 2)
        for s in shown:
            look = LOOKS[s]
            if s in ("before", "after"):
                left.stairs(
                    np.histogram(np.maximum(norms[s], edges[0]), edges)[0],
                    edges,
                    fill=not look.hollow,
                    color=look.color,
                    alpha=None if look.hollow else 0.75,
                    linewidth=1.0,
                )
            steps = evenly(len(norms[s]))  # of so many each is finer than a line is wide
            share = np.concatenate([[0.0], 100 * (steps + 1) / len(norms[s])])
            width = {"after": 1.4, "before": 1.6}.get(s, 1.0)  # the lines of states that coincide all show
            at = np.concatenate([edges[:1], norms[s][steps]])
            right.step(at, share, where="post", color=look.color, linestyle=look.line, linewidth=width)
        right.axhline(95, color=INK, linewidth=0.5, linestyle=":")
        right.set_yticks([0, 20, 40, 60, 80, 95])
        label = quantity(states["after"])
        counted = f"{states['after'].counted}s"
        left.set(xlabel=label, ylabel=counted, xlim=(edges[0], top), ylim=(0, None))
        right.set(xlabel=label, ylabel=f"{counted} below / %", xlim=(edges[0], top), ylim=(0, 103))
        left.yaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
        for panel in (left, right):
            grid(panel)
            if limit is not None:
                panel.axvline(limit, color=INK, linewidth=1.0, linestyle="--")
            if wide:
                panel.set_xscale("log")
                logarithmic(panel.xaxis)
        if limit is not None:
            _name_limit(left, limit)
        legend(figure, shown, markers=False, lines=True)
    title = f"Distribution of the {'true ' if part == 'truth' else ''}error"
    caption = _caption({s: states[s] for s in shown}, part, against)
    if limit is not None:
        caption += f" The dashed line is the tolerance, {number(limit)} {states['after'].unit}."
    return Illustration(settle(figure), name, title, caption)


def _name_limit(axes: Axes, limit: float) -> None:
    """`tolerance` beside its line, on the side where there is room: without colour it is one dashed line of several."""
    low, high = axes.get_xaxis().get_transform().transform(axes.get_xlim())
    beyond = axes.get_xaxis().get_transform().transform([limit])[0] > (low + high) / 2
    axes.annotate(
        "tolerance",
        (limit, 1.0),
        xycoords=axes.get_xaxis_transform(),
        xytext=(-2 if beyond else 2, -1),
        textcoords="offset points",
        ha="right" if beyond else "left",
        va="top",
        rotation=90,
        fontsize="small",
    )


def _caption(states: Mapping[str, Errors], part: str, against: str) -> str:
    after = states["after"]
    count = plural(len(after.size), f"{PARTS[part]} {after.counted}")
    what = "Position errors" if after.of_tool else opening(after.title)
    quantiles = [f"{number(float(np.percentile(e.size, 95)))} {e.unit} {_WORDS[s]}" for s, e in states.items()]
    caption = (
        f"{what} of {count}, against the {'simulated truth' if part == 'truth' else against}: number in each class "
        f"(left) and share below (right). 95 % of them are below {listed(quantiles)}."
    )
    if "before" in states:
        better = float(np.mean(after.size < states["before"].size))
        caption += f" The identification made {number(100 * better, 2)} % of them smaller."
    return caption
