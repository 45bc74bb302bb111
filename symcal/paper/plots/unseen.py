"""What positions of one point cannot tell."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from symcal.paper import published
from symcal.paper.results import Study
from symcal.plots.style import (
    BLUE,
    GREEN,
    INK,
    NARROW,
    ORANGE,
    VERMILION,
    WIDE,
    Illustration,
    grid,
    print_settings,
    settle,
    sheet,
)
from symcal.words import listed, number, symbol

Array = NDArray[np.float64]


def spectra(study: Study) -> Illustration:
    """Singular values at nominal, at the true errors, and with all three target points."""
    gauge = study.gauge
    n = len(gauge.seen.names)
    bottom = 1e-5
    with print_settings():
        figure = sheet(NARROW, 66)
        axes = figure.add_subplot()
        axes.axhline(1, color=INK, linewidth=0.8, linestyle="--", zorder=1)
        for seen, label, color, marker, filled in (
            (gauge.target, "three target points", GREEN, "^", False),
            (gauge.at_truth, "one point, true robot", ORANGE, "s", False),
            (gauge.seen, "one point, nominal robot", BLUE, "o", True),
        ):
            values = np.maximum(seen.singular_values, bottom)
            axes.plot(
                np.arange(1, n + 1),
                values,
                linestyle="none",
                marker=marker,
                color=color,
                markerfacecolor=color if filled else "white",
                markersize=3.4,
                label=f"{label}: {seen.rank} of {n}",
            )
        axes.set_yscale("log")
        axes.set_ylim(bottom / 3, 1e4)
        axes.set_yticks([10.0**k for k in range(-5, 5)])
        labels = ["≈ 0"] + [f"$10^{{{k}}}$" for k in range(-4, 5)]
        axes.set_yticklabels(labels)
        axes.minorticks_off()
        axes.set(xlabel="direction in parameter space, best seen first", ylabel="scaled singular value / 1")
        axes.set_xticks(range(1, n + 1, 2))
        grid(axes)
        axes.legend(loc="lower left")
    small = gauge.at_truth.singular_values[gauge.at_truth.rank :]
    caption = (
        f"Singular values of the Jacobian of the certified plan, scaled by noise and by plausible errors. Of "
        f"{n} directions {gauge.seen.rank} are above 1 (dashed) at nominal. At the true errors the other "
        f"{len(small)} are not zero, at most {number(float(small.max()), 2)}: enough for exact data, worth nothing "
        f"with noise. Three target points instead of one would show {gauge.target.rank}."
    )
    return Illustration(settle(figure), "paper_spectra", "What positions show", caption)


def spreads(study: Study) -> Illustration:
    """Deviation of identified errors from truth, per parameter: free, with a prior, and the paper's tables."""
    gauge, setting = study.gauge, study.setting
    names, scales = setting.model.parameters.names, setting.model.parameters.scales
    methods = {
        "unregularised": ("all free, as in the paper", VERMILION, "s", -0.12),
        "posterior": ("plausible sizes as prior", BLUE, "o", 0.12),
    }
    at = np.arange(len(names))
    with print_settings():
        figure = sheet(WIDE, 60)
        axes = figure.add_subplot()
        for key, (label, color, marker, offset) in methods.items():
            off = np.abs(gauge.spread[key] - setting.truth) / scales
            low, middle, high = np.percentile(off, [5, 50, 95], axis=0)
            axes.vlines(at + offset, np.maximum(low, 1e-5), high, color=color, linewidth=1.3)
            axes.plot(
                at + offset,
                middle,
                linestyle="none",
                marker=marker,
                color=color,
                markersize=3.0,
                markerfacecolor=color if key == "posterior" else "white",
                label=label,
            )
        for table, words, marker in (
            (published.TABLE_V, "paper, Table V", "x"),
            (published.TABLE_VI, "paper, Table VI", "+"),
        ):
            axes.plot(
                at - 0.38,
                _off(table, names, setting.truth, scales),
                linestyle="none",
                marker=marker,
                markersize=4,
                color=INK,
                label=words,
            )
        axes.axhline(1, color=INK, linewidth=0.8, linestyle="--", zorder=1)
        axes.set_yscale("log")
        axes.set_ylim(3e-4, 500)
        axes.minorticks_off()
        axes.set_xticks(at, [symbol(name) for name in names], fontsize=7.5)
        axes.set_xlim(-0.7, len(names) - 0.4)
        axes.set_ylabel("|identified − true| / plausible error")
        grid(axes)
        figure.legend(loc="outside upper center", ncols=5)
    count = len(gauge.spread["unregularised"])
    wander = _wandering(study)
    caption = (
        "Deviation of the identified from the true errors in units of a plausible error (1 mm, 10 mrad; dashed), "
        f"median and 5 to 95 % over {count} draws of the noise on the certified plan. Fitted all free, "
        f"{listed([symbol(name) for name in wander])} wander"
        + (", in our fits as in the paper's tables" if study.published_true else "")
        + "; with plausible sizes as prior they stay well within these and the other parameters are as good."
    )
    return Illustration(settle(figure), "paper_spreads", "Identified parameters against truth", caption)


def _wandering(study: Study) -> list[str]:
    """Parameters that deviate at least three times as much without regularisation as with plausible sizes as prior."""
    off = {key: np.abs(x - study.setting.truth) for key, x in study.gauge.spread.items()}
    free, held = (np.percentile(off[key], 95, axis=0) for key in ("unregularised", "posterior"))
    names = study.setting.model.parameters.names
    return [name for name, a, b in zip(names, free, held, strict=True) if a > 3 * b]


def _off(table: Mapping[str, float], names: tuple[str, ...], truth: Array, scales: Array) -> Array:
    return np.abs(np.array([table[name] for name in names]) - truth) / scales
