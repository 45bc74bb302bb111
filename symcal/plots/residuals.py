"""Residuals of the position by axis: what the model leaves, and whether it looks like noise."""

from __future__ import annotations

import numpy as np

from symcal.plots.panels import drawn_parts, dress, far_apart, legend, marker_size, places, titles
from symcal.plots.style import INK, LOOKS, WIDE, Comparison, Illustration, grid, marks, print_settings, settle, sheet
from symcal.words import listed, number, plural

_BINS = 41


def residuals_per_axis(errors: Comparison, against: str = "noisy measurement") -> Illustration:
    """Components x, y, z in world of the position error of every observation, before and after, with histograms.

    Where the errors before are so much larger that those after would be a line, only the latter are drawn.

    Args:
        errors: by part and state; `train` and `test` are drawn. against: what the errors are taken against.
    """
    parts = drawn_parts(errors)
    counts = [len(errors[part]["after"].vectors) for part in parts]
    at = places(counts)
    pooled = {
        s: np.vstack([errors[part][s].vectors for part in parts]) for s in ("before", "after") if s in errors[parts[0]]
    }
    hidden = far_apart({s: np.linalg.norm(v, axis=1) for s, v in pooled.items()})
    if hidden:
        pooled = {"after": pooled["after"]}
    states = list(pooled)
    limit = 1.08 * max(float(np.abs(v).max()) for v in pooled.values()) or 1.0
    edges = np.linspace(-limit, limit, _BINS + 1)
    with print_settings():
        figure = sheet(WIDE, 84)
        axes = figure.subplots(3, 2, sharex="col", sharey=True, width_ratios=[5, 1])
        for i, (series, histogram) in enumerate(axes):
            for state in states:
                look = LOOKS[state]
                x, values = np.concatenate(at), pooled[state][:, i]
                series.plot(x, values, **marks(look), markersize=marker_size(counts), zorder=3)
                histogram.stairs(
                    np.histogram(values, edges)[0],
                    edges,
                    orientation="horizontal",
                    fill=not look.hollow,
                    color=look.color,
                    alpha=None if look.hollow else 0.75,
                    linewidth=0.9,
                )
            for panel in (series, histogram):
                grid(panel)
                panel.axhline(0, color=INK, linewidth=0.5, zorder=1)
            dress(series, at, titles(errors, parts) if i == 0 else ())
            series.set_ylabel(f"error in {'xyz'[i]} / mm")
        axes[0, 0].set_ylim(-limit, limit)
        axes[2, 0].set_xlabel("observation, in the order of the measurement")
        axes[2, 1].set_xlabel("observations")
        legend(figure, states, markers=True, lines=False)
    mean, spread = pooled["after"].mean(axis=0), pooled["after"].std(axis=0)
    bias, sigma = (
        listed([f"{number(v, 2)} mm in {c}" for v, c in zip(values, "xyz", strict=True)]) for values in (mean, spread)
    )
    caption = (
        f"Components of the position error in world, model minus {against.removeprefix('noisy ')}, of "
        f"{plural(sum(counts), 'observation')}; histograms over all of them. After the identification the mean is "
        f"{bias}, the standard deviation {sigma}. A pattern over the poses would be an effect that the model lacks."
    )
    if hidden:
        caption += " The errors before are so much larger that they are not drawn."
    return Illustration(settle(figure), "residuals_per_axis", "Residuals by axis", caption)
