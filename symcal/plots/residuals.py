"""Residuals by component: what the model leaves, and whether it looks like noise."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from symcal.calibration.evaluate import Errors
from symcal.plots.panels import (
    drawn,
    drawn_parts,
    drawn_words,
    dress,
    far_apart,
    legend,
    marker_size,
    opening,
    places,
    titles,
)
from symcal.plots.style import INK, LOOKS, WIDE, Comparison, Illustration, grid, marks, print_settings, settle, sheet
from symcal.words import listed, number, plural

Array = NDArray[np.float64]

_BINS = 41
_ROUNDING = 1e-6  # of the standard deviation: a mean below is none
_AXES = ("x", "y", "z")


def residuals_per_axis(errors: Comparison, against: str = "noisy measurement") -> Illustration:
    """Components of the error of every observation (of points x, y, z in world, of contacts along their place's axes),
    before and after, with histograms.

    Where the errors before are so much larger that those after would be a line, only the latter are drawn.

    Args:
        errors: by part and state; `train` and `test` are drawn. against: what the errors are taken against.
    """
    parts = drawn_parts(errors)
    counts = [len(errors[part]["after"].vectors) for part in parts]
    pooled = {
        s: np.vstack([errors[part][s].vectors for part in parts]) for s in ("before", "after") if s in errors[parts[0]]
    }
    hidden = far_apart({s: np.linalg.norm(v, axis=1) for s, v in pooled.items()})
    if hidden:
        pooled = {"after": pooled["after"]}
    judged = errors[parts[0]]["after"]
    labels = _labels(judged)
    limit = 1.08 * max(float(np.abs(v).max()) for v in pooled.values()) or 1.0
    at = places(counts)
    with print_settings():
        figure = sheet(WIDE, 30 + 18 * len(labels))
        axes = figure.subplots(len(labels), 2, sharex="col", sharey=True, width_ratios=[5, 1], squeeze=False)
        for i, (series, histogram) in enumerate(axes):
            _draw(series, histogram, {s: v[:, i] for s, v in pooled.items()}, np.concatenate(at), limit)
            dress(series, at, titles(errors, parts) if i == 0 else ())
            series.set_ylabel(labels[i])
        axes[0, 0].set_ylim(-limit, limit)
        axes[-1, 0].set_xlabel(f"{judged.counted}, in the order of the measurement")
        axes[-1, 1].set_xlabel(f"{judged.counted}s")
        legend(figure, list(pooled), markers=True, lines=False)
    caption = _caption(judged, pooled["after"], against.removeprefix("noisy "))
    caption += drawn_words([len(pooled["after"])], f"{judged.counted}s")
    if hidden:
        caption += " The errors before are so much larger that they are not drawn."
    title = "Residuals" if len(labels) == 1 else f"Residuals by {'axis' if judged.names == _AXES else 'component'}"
    return Illustration(settle(figure), "residuals_per_axis", title, caption)


def _labels(errors: Errors) -> list[str]:
    """What the axis of each component says."""
    if len(errors.names) == 1:
        return [f"error / {errors.unit}"]
    if errors.names == _AXES:
        return [f"error in {axis} / {errors.unit}" for axis in _AXES]
    return [f"{name.replace('_', ' ')} / {errors.unit}" for name in errors.names]


def _draw(series: Axes, histogram: Axes, states: Mapping[str, Array], at: Array, limit: float) -> None:
    """One component of every observation by state, shape (k,), over its place and as a histogram."""
    edges = np.linspace(-limit, limit, _BINS + 1)
    for state, values in states.items():
        look = LOOKS[state]
        shown = drawn(values)
        series.plot(at[shown], values[shown], **marks(look), markersize=marker_size([len(at)]), zorder=3)
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


def _caption(errors: Errors, after: Array, against: str) -> str:
    """Args: after: components of all observations after the identification, shape (k, d)."""
    average, deviation = after.mean(axis=0), after.std(axis=0)
    average = np.where(np.abs(average) > _ROUNDING * deviation, average, 0.0)  # fitted places leave none
    mean, spread = _each(errors, average), _each(errors, deviation)
    what = f"components of the {errors.title}" if len(errors.names) > 1 else errors.title
    where = f" along the axes of {errors.axes}" if errors.axes != "world" else " in world"
    where = where if errors.names == _AXES else ""
    difference = f"model minus {against}"
    if errors.counted == "contact":
        flat = len(errors.names) == 1
        difference = (
            "how high above it the model has the point" if flat else "where the model has the point, seen from it"
        )
    return (
        f"{opening(what)}{where}, {difference}, of {plural(len(after), errors.counted)}; histograms over all "
        f"of them. After the identification the mean is {mean}, the standard deviation {spread}. A pattern over the "
        "poses would be an effect that the model lacks."
    )


def _each(errors: Errors, values: Array) -> str:
    """A value of every component with its unit and, where there are several, its name."""
    shown = [f"{number(float(value), 2)} {errors.unit}" for value in values]
    if len(shown) == 1:
        return shown[0]
    names = [name.replace("_", " ") for name in errors.names]
    return listed([f"{value} in {name}" for value, name in zip(shown, names, strict=True)])
