"""What was identified: corrections with their uncertainty, and how they hang together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.fit.estimation import Fit
from symcal.parameters import Unit
from symcal.plots.style import BLUE, FAINT, INK, WIDE, Illustration, escaped, grid, print_settings, settle, sheet
from symcal.robot.robot import Robot
from symcal.units import SHOWN, in_mrad
from symcal.words import MOSTLY, free_parameters, is_term_number, listed, number, plural, symbol

Array = NDArray[np.float64]

_LEARNT: dict[str, Any] = {"color": BLUE, "marker": "o"}
_SHARES = ("10⁻³", 1e3)
_IN_ROW = 40  # numbers of joint terms
_TOGETHER = 24  # of them and others in one row of panels
_ASSUMED: dict[str, Any] = {"color": FAINT, "marker": "D", "markerfacecolor": "white"}


def parameter_corrections(calibration: Calibration) -> Illustration:
    """Identified minus nominal of the free parameters of links and joint terms with 95 % intervals, by unit.

    Filled where a parameter was mostly learnt from the data; hollow and grey where it is mostly assumed.
    """
    model, fit = calibration.model, calibration.after
    errors = model.parameters.mapping(fit.x)
    known = fit.posterior
    half = dict(zip(known.names, known.half_widths().tolist(), strict=True))
    share = dict(zip(known.names, known.learnt.tolist(), strict=True))
    names = [name for name in model.robot.parameters if name in half]
    unit = dict(zip(model.parameters.names, model.parameters.units, strict=True))
    learnt = [n for n in names if share[n] >= MOSTLY]
    rows = _panels(names, unit, model.robot)
    with print_settings():
        figure = sheet(WIDE, 56 * len(rows) + 8 * (len(rows) - 1))
        for part, panels in zip(figure.subfigures(len(rows), 1, squeeze=False)[:, 0], rows, strict=True):
            ratios = [len(group) + 2 for group, _ in panels]
            axes = part.subplots(1, len(panels), width_ratios=ratios, squeeze=False)[0]
            for panel, (group, kind) in zip(axes, panels, strict=True):
                label, factor = _SHARES if kind == "1" else in_mrad(kind)
                values, bars = (factor * np.array([of[n] for n in group]) for of in (errors, half))
                _corrections(panel, group, values, bars, np.array([n in learnt for n in group]))
                panel.set_ylabel(f"correction / {label}")
        figure.legend(handles=[_handle(True), _handle(False)], loc="outside upper center", ncols=2)
    caption = _caption(names, learnt, errors, half, unit)
    return Illustration(settle(figure), "parameter_corrections", "Identified corrections", caption)


def _panels(names: list[str], unit: Mapping[str, Unit], robot: Robot) -> list[list[tuple[list[str], Unit]]]:
    """Rows of panels: names and their unit; links first, then joint terms, angles by themselves where they are many."""
    terms = robot.term_parameters
    links = [n for n in names if n not in terms]
    angles = in_rows([n for n in names if n in terms and unit[n] == "rad"], robot)
    others = [n for row in in_rows([n for n in names if n in terms and unit[n] != "rad"], robot) for n in row]
    parts = [links, *angles]
    if others and angles and len(parts[-1]) + len(others) <= _TOGETHER:
        parts[-1] = [*parts[-1], *others]
    else:
        parts.append(others)
    kinds: list[Unit] = ["rad", "mm", "1", "rad/mm", "mm/rad", "rad/Nmm", "mm/N"]
    rows = [[([n for n in part if unit[n] == k], k) for k in kinds] for part in parts]
    return [[panel for panel in row if panel[0]] for row in rows if any(group for group, _ in row)]


def in_rows(names: list[str], robot: Robot) -> list[list[str]]:
    """Numbers of joint terms in rows: those of one group together, in the order of the robot file."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(robot.term_parameters[name].group, []).append(name)
    rows: list[list[str]] = []
    for group in groups.values():
        if rows and len(rows[-1]) + len(group) <= _IN_ROW:
            rows[-1] += group
        else:
            rows += [group[k : k + _IN_ROW] for k in range(0, len(group), _IN_ROW)]
    return rows


def _corrections(axes: Axes, names: list[str], values: Array, bars: Array, learnt: NDArray[np.bool_]) -> None:
    at = np.arange(len(names))
    crowded = len(names) > 22
    size = 2.6 if crowded else 3.5
    axes.axhline(0, color=INK, linewidth=0.5, zorder=1)
    for mask, look in ((~learnt, _ASSUMED), (learnt, _LEARNT)):
        axes.errorbar(
            at[mask],
            values[mask],
            yerr=bars[mask],
            linestyle="none",
            markersize=size,
            capsize=0.55 * size,
            capthick=0.8,
            elinewidth=0.9,
            zorder=3,
            **look,
        )
    axes.set_xlim(-0.8, len(names) - 0.2)
    wordy = any(is_term_number(n) for n in names)
    axes.set_xticks(
        at,
        [escaped(symbol(n)) for n in names],
        fontsize=6 if crowded else 7,
        rotation=90 if wordy else 0,
    )
    axes.tick_params(axis="x", length=0)
    grid(axes)


def _handle(learnt: bool) -> Line2D:
    label = "mostly learnt from the data" if learnt else "mostly assumed: the data say little"
    return Line2D([], [], linestyle="-", markersize=3.5, label=label, **(_LEARNT if learnt else _ASSUMED))


def _caption(
    names: list[str], learnt: list[str], errors: dict[str, float], half: dict[str, float], unit: Mapping[str, Unit]
) -> str:
    sure = sum(abs(errors[n]) > half[n] for n in learnt)
    caption = (
        f"Corrections (identified minus nominal) of the {free_parameters(names)} with 95 % "
        f"intervals. Filled: {len(learnt)} that were mostly learnt from the data; for {sure} of them the nominal value "
        "lies outside the interval."
    )
    largest = []
    for kind in ("rad", "mm", *(k for k in SHOWN if k not in ("rad", "mm", "px"))):
        group, (label, factor) = [n for n in learnt if unit[n] == kind], in_mrad(kind)
        if group:
            name = max(group, key=lambda n: abs(errors[n]))
            largest.append(f"{number(errors[name] * factor)} {'' if label == '1' else f'{label} '}of {symbol(name)}")
    if largest:
        caption += f" The largest: {listed(largest)}."
    if len(learnt) < len(names):
        caption += (
            f" Hollow and grey: {len(names) - len(learnt)} that are mostly assumed. The data say little "
            "about each by itself: it is drawn to nominal, and its bar is mostly the size of error thought plausible."
        )
    return caption


def correlation_matrix(fit: Fit) -> Illustration:
    """Correlations of the parameters that were mostly learnt from the data, as a lower triangle; dashes: negative.

    Raises:
        ValueError: fewer than two parameters were mostly learnt.
    """
    keep = np.flatnonzero(fit.posterior.learnt >= MOSTLY)
    n = len(keep)
    if n < 2:
        raise ValueError("a correlation takes two parameters that were learnt from the data")
    matrix = fit.posterior.correlation()[np.ix_(keep, keep)]
    names = [symbol(fit.posterior.names[i]) for i in keep]
    side = float(np.clip(3.3 * n + 24, 82, 150))
    shown = np.ma.masked_where(np.triu(np.ones((n, n), dtype=bool)), matrix)[1:, :-1]
    with print_settings():
        figure = sheet(side, side)
        axes = figure.add_subplot()
        image = axes.imshow(shown, cmap="RdBu_r", vmin=-1, vmax=1, aspect="equal", interpolation="none")
        _cell_edges(axes, n - 1)
        rows, columns = np.nonzero(np.tril(matrix, -1)[1:, :-1] < -0.3)
        dark = matrix[rows + 1, columns] < -0.6
        bars = [[(c - 0.22, r), (c + 0.22, r)] for r, c in zip(rows, columns, strict=True)]
        axes.add_collection(
            LineCollection(bars, colors=["white" if d else INK for d in dark], linewidths=0.7), autolim=False
        )
        size = 6.5 if n <= 25 else 5.5 if n <= 60 else 5.5 * 60 / n
        axes.set_xticks(range(n - 1), [escaped(k) for k in names[:-1]], rotation=90, fontsize=size)
        axes.set_yticks(range(n - 1), [escaped(k) for k in names[1:]], fontsize=size)
        axes.tick_params(length=0, pad=2)
        axes.spines[:].set_visible(False)
        inset = axes.inset_axes((0.52, 0.93, 0.46, 0.025))
        bar = figure.colorbar(image, cax=inset, orientation="horizontal", ticks=[-1, -0.5, 0, 0.5, 1])
        bar.set_label("correlation (dash: below −0.3)")
        inset.tick_params(length=1.5)
    pairs = np.tril(np.abs(matrix), -1)
    order = np.argsort(pairs, axis=None)[::-1][: min(3, n * (n - 1) // 2)]
    strongest = listed(
        [f"{names[k % n]} with {names[k // n]} ({number(float(matrix[k // n, k % n]), 2)})" for k in order.tolist()]
    )
    strong = int(np.sum(pairs > 0.9))
    caption = (
        f"Correlations of the {n} parameters that were mostly learnt from the data, frames included. "
        f"Strongest: {strongest}. "
        + (
            f"{plural(strong, 'pair')} above 0.9 in size: known better together than each by itself."
            if strong
            else "None is above 0.9 in size."
        )
    )
    return Illustration(settle(figure), "correlation", "Correlations", caption)


def _cell_edges(axes: Axes, count: int) -> None:
    edges = np.arange(count + 1) - 0.5
    upright = [[(e, max(e - 1, -0.5)), (e, count - 0.5)] for e in edges]
    level = [[(-0.5, e), (min(e + 1, count - 0.5), e)] for e in edges]
    axes.add_collection(LineCollection([*upright, *level], colors="white", linewidths=0.5), autolim=False)
