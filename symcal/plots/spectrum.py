"""What the data can see: the singular values of the scaled Jacobian."""

from __future__ import annotations

import numpy as np

from symcal.identifiability import NUMERICAL, Identifiability
from symcal.plots.style import FAINT, INK, NARROW, Illustration, grid, print_settings, settle, sheet
from symcal.words import number, plural


def singular_values(seen: Identifiability) -> Illustration:
    """Singular values of the whitened, scaled Jacobian with the threshold 1 and the rank."""
    values = seen.singular_values
    n = len(values)
    floor = NUMERICAL * float(values[0])
    zero = np.arange(n) >= seen.numerical_rank
    determined = np.arange(n) < seen.rank - seen.released
    released = np.zeros(n, dtype=bool)
    released[[int(np.argmin(np.abs(values - v))) for v in seen.seen_values[seen.rank - seen.released :]]] = True
    hidden = ~(determined | zero | released)
    lowest = float(values[~zero].min())
    at = np.arange(1, n + 1)
    with print_settings():
        figure = sheet(NARROW, 62)
        axes = figure.add_subplot()
        axes.axhline(1, color=INK, linewidth=0.8, linestyle="--")
        axes.annotate("threshold", (n + 0.5, 1), xytext=(0, 2), textcoords="offset points", ha="right", fontsize=6)
        bottom = min(lowest, 1.0) / 30
        for mask, style, label in (
            (determined, {"marker": "o", "color": "#00517F"}, "determined"),
            (released, {"marker": "s", "color": "#009E73"}, "released: data contradict nominal"),
            (hidden, {"marker": "D", "color": "#D55E00", "markerfacecolor": "white"}, "below the noise"),
        ):
            if mask.any():
                axes.plot(
                    at[mask],
                    values[mask],
                    linestyle="none",
                    label=f"{label}: {int(mask.sum())}"
                    if label != "released: data contradict nominal"
                    else f"released: {int(mask.sum())}",
                    markersize=3.2,
                    **style,
                )
        if zero.any():
            axes.plot(
                at[zero],
                np.full(int(zero.sum()), bottom * 2),
                linestyle="none",
                marker="v",
                color=FAINT,
                markerfacecolor="white",
                markersize=3.2,
                label=f"zero to rounding: {int(zero.sum())}",
            )
        axes.set_yscale("log")
        axes.set_ylim(bottom, float(values[0]) * 3)
        axes.set_xlim(0.2, n + 0.8)
        axes.set_xlabel("direction in parameter space")
        axes.set_ylabel("singular value (scaled by\nplausible error and noise)")
        axes.xaxis.get_major_locator().set_params(integer=True)
        grid(axes)
        axes.legend(loc="upper right")
    hidden_words = n - seen.rank
    caption = (
        f"The data determine {seen.rank} of {plural(n, 'direction')} better than the plausible size of its error (singular value above 1); "
        f"the largest is {number(float(values[0]))}, the smallest that counts {number(float(seen.seen_values.min()) if seen.rank else 0.0)}. "
    )
    if seen.released:
        caption += f"{seen.released} of them below the threshold, but released because the data contradict the nominal value there. "
    caption += (
        f"{plural(hidden_words, 'direction')} {'stays' if hidden_words == 1 else 'stay'} at nominal."
        if hidden_words
        else "None stays at nominal."
    )
    return Illustration(settle(figure), "singular_values", "What the data can see", caption)
