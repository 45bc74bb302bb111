"""How the errors are distributed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.ticker import MaxNLocator

from symcal.calibration.evaluate import Errors
from symcal.plots.panels import SHOWN, far_apart, legend, logarithmic
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
) -> Illustration:
    """Histogram and cumulative distribution of the norms of the position error, by state.

    Args:
        states: errors by state, of one part of the data. part: which one (`test`, `truth`, ...), for the words.
        name: of the figure's files.
    """
    shown = [s for s in ("before_raw", *SHOWN) if s in states]
    norms = {s: np.sort(states[s].position) for s in shown}
    top = max(float(v[-1]) for v in norms.values()) or 1.0
    wide = far_apart(norms)
    bottom = 0.8 * min(float(np.percentile(v, 2)) for v in norms.values()) if wide else 0.0
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
            share = 100 * np.arange(len(norms[s]) + 1) / len(norms[s])
            width = {"after": 1.4, "before": 1.6}.get(s, 1.0)  # the lines of states that coincide all show
            at = np.concatenate([edges[:1], norms[s]])
            right.step(at, share, where="post", color=look.color, linestyle=look.line, linewidth=width)
        right.axhline(95, color=INK, linewidth=0.5, linestyle=":")
        right.set_yticks([0, 20, 40, 60, 80, 95])
        left.set(xlabel="position error / mm", ylabel="observations", xlim=(edges[0], top), ylim=(0, None))
        right.set(xlabel="position error / mm", ylabel="observations below / %", xlim=(edges[0], top), ylim=(0, 103))
        left.yaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
        for panel in (left, right):
            grid(panel)
            if wide:
                panel.set_xscale("log")
                logarithmic(panel.xaxis)
        legend(figure, shown, markers=False, lines=True)
    truth = part == "truth"
    count = plural(len(norms["after"]), f"{PARTS[part]} observation")
    quantiles = listed([f"{number(float(np.percentile(norms[s], 95)))} mm {_WORDS[s]}" for s in shown])
    caption = (
        f"Position errors of {count}, against the {'simulated truth' if truth else against}: number in each class "
        f"(left) and share below (right). 95 % of them are below {quantiles}."
    )
    if "before" in states:
        better = float(np.mean(states["after"].position < states["before"].position))
        caption += f" The identification made {number(100 * better, 2)} % of them smaller."
    return Illustration(settle(figure), name, f"Distribution of the {'true ' if truth else ''}error", caption)
