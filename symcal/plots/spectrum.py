"""What the data can see: the singular values of the scaled Jacobian."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import MaxNLocator

from symcal.fit.identifiability import Identifiability
from symcal.plots.style import (
    BLUE,
    FAINT,
    INK,
    NARROW,
    VERMILION,
    Illustration,
    grid,
    print_settings,
    settle,
    sheet,
)
from symcal.words import number, plural


def singular_values(seen: Identifiability) -> Illustration:
    """Singular values of the whitened, scaled Jacobian: seen (above 1), hardly seen, and not at all (zero to rounding).

    At 1 the measurements say as much about a direction as its plausible size; nothing is cut off there.
    """
    values = seen.singular_values
    n = len(values)
    at = np.arange(1, n + 1)
    zero = np.arange(n) >= seen.numerical_rank
    clear = np.arange(n) < seen.rank
    faint = ~(clear | zero)
    lowest = float(values[~zero].min()) if (~zero).any() else 1.0
    bottom = min(lowest, 1.0) / 30
    with print_settings():
        figure = sheet(NARROW, 60)
        axes = figure.add_subplot()
        axes.axhline(1, color=INK, linewidth=0.8, linestyle="--", zorder=1)
        for mask, label, color, marker, filled in (
            (clear, "seen", BLUE, "o", True),
            (faint, "hardly seen", VERMILION, "D", False),
        ):
            if mask.any():
                axes.plot(
                    at[mask],
                    values[mask],
                    linestyle="none",
                    marker=marker,
                    color=color,
                    markerfacecolor=color if filled else "white",
                    label=f"{label}: {int(mask.sum())}",
                )
        if zero.any():
            axes.plot(
                at[zero],
                np.full(int(zero.sum()), 2 * bottom),
                linestyle="none",
                marker="v",
                color=FAINT,
                markerfacecolor="white",
                label=f"not at all (drawn at the edge): {int(zero.sum())}",
            )
        axes.set_yscale("log")
        axes.set_ylim(bottom, max(float(values[0]), 1.0) * 3)
        axes.set_xlim(0.2, n + 0.8)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel="combination of parameters, best seen first", ylabel="scaled singular value / 1")
        axes.minorticks_off()
        grid(axes)
        axes.legend(loc="best")
    caption = (
        "How clearly the measurements see each independent combination (direction) of the parameters: singular values "
        "of the Jacobian, scaled by the noise and by the plausible size of each error. At 1 (dashed) the data say "
        f"as much as that size does. {seen.rank} of {plural(n, 'direction')} {'is' if seen.rank == 1 else 'are'} above "
        "it and count as seen"
    )
    if seen.rank:
        caption += f" (largest {number(float(values[0]))}, smallest {number(float(seen.seen_values.min()))})"
    caption += "."
    if seen.rank < n:
        caption += " Along the others the assumption says more than the data."
    return Illustration(settle(figure), "singular_values", "What the data can see", caption)
