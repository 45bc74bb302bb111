"""What the data can see: the singular values of the scaled Jacobian."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import MaxNLocator

from symcal.identification.identifiability import Identifiability
from symcal.plots.style import (
    BLUE,
    FAINT,
    GREEN,
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
    """Singular values of the whitened, scaled Jacobian: above the threshold 1, below it, and zero to rounding."""
    values = seen.singular_values
    n = len(values)
    at = np.arange(1, n + 1)
    zero = np.arange(n) >= seen.numerical_rank
    determined = np.arange(n) < seen.rank - seen.released
    released = ~determined & np.isin(values, seen.seen_values) & ~zero
    hidden = ~(determined | released | zero)
    lowest = float(values[~zero].min()) if (~zero).any() else 1.0
    bottom = min(lowest, 1.0) / 30
    with print_settings():
        figure = sheet(NARROW, 60)
        axes = figure.add_subplot()
        axes.axhline(1, color=INK, linewidth=0.8, linestyle="--", zorder=1)
        for mask, label, color, marker, filled in (
            (determined, "determined", BLUE, "o", True),
            (released, "released", GREEN, "s", True),
            (hidden, "below the threshold", VERMILION, "D", False),
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
                label=f"zero (drawn at the edge): {int(zero.sum())}",
            )
        axes.set_yscale("log")
        axes.set_ylim(bottom, max(float(values[0]), 1.0) * 3)
        axes.set_xlim(0.2, n + 0.8)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel="direction in parameter space, best seen first", ylabel="scaled singular value / 1")
        axes.minorticks_off()
        grid(axes)
        axes.legend(loc="best")
    left = n - seen.rank
    caption = (
        "Singular values of the Jacobian, scaled by the noise and by the plausible size of each error. The data "
        f"determine {seen.rank} of {plural(n, 'direction')}: above the threshold 1 (dashed) they know better than the "
        "plausible size."
    )
    if seen.released:
        verb = "is" if seen.released == 1 else "are"
        caption += f" {seen.released} below it {verb} released: the data contradict the nominal value."
    if seen.rank:
        caption += f" Largest {number(float(values[0]))}, smallest that counts {number(float(seen.seen_values.min()))};"
        caption += f" {left or 'none'} {'stays' if left == 1 else 'stay'} at nominal."
    return Illustration(settle(figure), "singular_values", "What the data can see", caption)
