"""What was identified: corrections with their uncertainty, and how they hang together."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from symcal import uncertainty
from symcal.estimation import Fit
from symcal.identify import Calibration
from symcal.plots.style import INK, WIDE, Illustration, grid, print_settings, settle, sheet
from symcal.words import listed, number, plural, symbol

Array = NDArray[np.float64]

_DETERMINED, _OPEN = "#00517F", "#999999"


def parameter_corrections(calibration: Calibration) -> Illustration:
    """Identified minus nominal of the link parameters with two standard deviations; hollow where the data do not determine it.

    Angles in mrad and lengths in mm, in a panel each.
    """
    model, fit = calibration.model, calibration.after
    errors = model.parameters.mapping(fit.x)
    sigma = dict(zip(fit.free, uncertainty.sigmas(fit.identifiability), strict=True))
    names = [name for name in model.robot.parameters if name in sigma]
    unit = dict(zip(model.parameters.names, model.parameters.units, strict=True))
    panels = [
        (group, factor, label)
        for group, factor, label in (
            ([n for n in names if unit[n] == "rad"], 1e3, "correction / mrad"),
            ([n for n in names if unit[n] == "mm"], 1.0, "correction / mm"),
        )
        if group
    ]
    with print_settings():
        figure = sheet(WIDE, 58)
        ratios = [len(group) + 1.5 for group, _, _ in panels]
        axes = figure.subplots(1, len(panels), width_ratios=ratios, squeeze=False)[0]
        for panel, (group, factor, label) in zip(axes, panels, strict=True):
            _corrections(panel, group, [errors[n] * factor for n in group], [_times(sigma[n], factor) for n in group])
            panel.set_ylabel(label)
        handles = [
            Line2D(
                [],
                [],
                color=_DETERMINED,
                marker="o",
                linestyle="-",
                markersize=3.5,
                label="correction ± 2 standard deviations",
            ),
            Line2D(
                [],
                [],
                color=_OPEN,
                marker="D",
                linestyle="none",
                markerfacecolor="white",
                markersize=3.5,
                label="not determined by the data",
            ),
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=2)
    known = [n for n in names if sigma[n] is not None]
    significant = [n for n in known if abs(errors[n]) > 2 * (sigma[n] or 0.0)]
    caption = (
        f"Corrections of the {plural(len(names), 'link parameter')}. The data determine {len(known)} of them one by one; {len(significant)} differ from "
        "nominal by more than two standard deviations."
    )
    caption += _largest(errors, known, unit)
    if len(known) < len(names):
        caption += " A hollow mark is part of a combination that the data cannot resolve: its value is a convention (nearest to nominal), not a finding."
    return Illustration(settle(figure), "parameter_corrections", "Identified corrections", caption)


def _times(sigma: float | None, factor: float) -> float | None:
    return None if sigma is None else sigma * factor


def _corrections(axes: Axes, names: list[str], values: list[float], sigmas: list[float | None]) -> None:
    for i, (value, sigma) in enumerate(zip(values, sigmas, strict=True)):
        if sigma is None:
            axes.plot([i], [value], color=_OPEN, marker="D", markerfacecolor="white", markersize=3.5, zorder=3)
        else:
            axes.errorbar(
                [i],
                [value],
                yerr=[2 * sigma],
                color=_DETERMINED,
                marker="o",
                markersize=3.5,
                capsize=1.8,
                capthick=0.8,
                elinewidth=0.9,
                zorder=3,
            )
    axes.axhline(0, color=INK, linewidth=0.5)
    axes.set_xlim(-0.8, len(names) - 0.2)
    axes.set_xticks(range(len(names)), [symbol(n) for n in names], fontsize=7 if len(names) <= 22 else 5.5)
    axes.tick_params(axis="x", length=0)
    grid(axes)


def _largest(errors: dict[str, float], names: list[str], unit: dict[str, str]) -> str:
    parts = []
    for kind, factor, label in (("rad", 1e3, "mrad"), ("mm", 1.0, "mm")):
        group = [n for n in names if unit[n] == kind]
        if group:
            name = max(group, key=lambda n: abs(errors[n]))
            parts.append(f"{number(errors[name] * factor)} {label} of {name}")
    return f" The largest are {listed(parts)}." if len(parts) > 1 else f" The largest is {parts[0]}." if parts else ""


def correlation_matrix(fit: Fit) -> Illustration:
    """Correlations of the parameters that the data determine, as the lower triangle; a bar marks the clearly negative ones.

    Raises:
        ValueError: fewer than two parameters are determined.
    """
    seen = fit.identifiability
    keep = [i for i, sigma in enumerate(uncertainty.sigmas(seen)) if sigma is not None]
    if len(keep) < 2:
        raise ValueError("a correlation takes two parameters that the data determine")
    matrix = uncertainty.correlation(seen)[np.ix_(keep, keep)]
    names = [seen.names[i] for i in keep]
    n = len(keep)
    side = float(np.clip(4.2 * n + 30, 85, 150))
    shown = np.ma.masked_where(np.triu(np.ones((n, n), dtype=bool)), matrix)[1:, :-1]
    with print_settings():
        figure = sheet(side + 14, side)
        axes = figure.add_subplot()
        image = axes.imshow(shown, cmap="RdBu_r", vmin=-1, vmax=1, aspect="equal", interpolation="none")
        for row, column in zip(*np.nonzero(np.tril(matrix[1:, :-1] < -0.3)), strict=True):
            axes.plot(
                [column - 0.22, column + 0.22],
                [row, row],
                color="white" if matrix[row + 1, column] < -0.6 else INK,
                linewidth=0.7,
            )
        size = 6.5 if n <= 25 else 5.5
        axes.set_xticks(range(n - 1), [symbol(k) for k in names[:-1]], rotation=90, fontsize=size)
        axes.set_yticks(range(n - 1), [symbol(k) for k in names[1:]], fontsize=size)
        axes.tick_params(length=0, pad=2)
        for edge in np.arange(-0.5, n - 1):
            axes.plot([edge, edge], [edge, n - 1.5], color="white", linewidth=0.5)
            axes.plot([-0.5, edge + 1], [edge, edge], color="white", linewidth=0.5)
        axes.spines[:].set_visible(False)
        bar = figure.colorbar(image, ax=axes, shrink=0.6, aspect=25, pad=0.02, ticks=[-1, -0.5, 0, 0.5, 1])
        bar.set_label("correlation (bar in a cell: negative)")
        bar.outline.set_linewidth(0.4)  # type: ignore[operator]
    pairs = np.tril(np.abs(matrix), -1)
    order = np.argsort(pairs, axis=None)[::-1][: min(3, n * (n - 1) // 2)]
    named = [(int(k) // n, int(k) % n) for k in order]
    strongest = listed([f"{names[j]} with {names[i]} ({number(float(matrix[i, j]), 2)})" for i, j in named])
    strong = int(np.sum(pairs > 0.9))
    caption = f"Correlations of the {n} parameters that the data determine one by one. Strongest: {strongest}. " + (
        f"{plural(strong, 'pair')} above 0.9 in size: they are known better as a sum or difference than each by itself."
        if strong
        else "None is above 0.9 in size."
    )
    return Illustration(settle(figure), "correlation", "Correlations", caption)
