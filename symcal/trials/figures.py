"""The figures of a study: how errors are distributed, what they need, and whether the stated intervals hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from symcal.plots.style import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    VERMILION,
    WIDE,
    Illustration,
    escaped,
    grid,
    print_settings,
    settle,
    sheet,
)
from symcal.trials.need import OF, groups, judged_words, label, words
from symcal.trials.statistics import SHOWN, Share, judged_column, judged_values, pooled, quantile
from symcal.trials.store import Store
from symcal.words import number, plural, symbol

Array = NDArray[np.float64]
Content = Mapping[str, Any]

_COLORS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, INK, FAINT, "#56B4E9")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<")
_LINES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)), (0, (3, 1, 1, 1)), (0, (7, 2)))
MOST = len(_COLORS)
"""Series that are told apart in one panel."""
_ROWS = 24  # cells that are listed below each other


def study_figures(content: Content, store: Store) -> tuple[Illustration, ...]:
    """All figures, from results.json and the trials' own numbers."""
    return (error_figure(content, store), need_figure(content, store), coverage_figure(content))


def _spread(count: int, most: int) -> list[int]:
    """So many of a row of things, evenly, with the first and the last."""
    return sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))


def _axis_name(content: Content) -> str:
    """The judged error beside an axis; in two lines where it is too long for one."""
    return f"{judged_words(content['question'])} of a trial / mm".replace(" against", "\nagainst")


def _column(content: Content) -> str:
    return judged_column(content["question"]["of"], content["question"]["against"])


def error_figure(content: Content, store: Store) -> Illustration:
    """Distribution of the judged error over trials, and quantiles of every cell."""
    cells, question = content["cells"], content["question"]
    tolerance, name = question["tolerance_mm"], judged_words(question)
    chosen, repetitions = _spread(len(cells), MOST), content["repetitions"]
    with print_settings():
        listed = [cells[i] for i in _spread(len(cells), _ROWS)]
        figure = sheet(WIDE, max(58.0, 34.0 + 4.2 * len(listed)))
        left, right = figure.subplots(1, 2)
        for k, i in enumerate(chosen):
            values = judged_values(store, cells[i]["cell"], _column(content), repetitions)
            finite = values[np.isfinite(values)]
            share = 100 * np.arange(1, len(finite) + 1) / repetitions
            look = {"color": _COLORS[k], "linestyle": _LINES[k], "label": escaped(label(cells[i], content["varied"]))}
            left.step(finite, share, where="post", **look)
        left.set(xlabel=_axis_name(content), ylabel="trials below / %", ylim=(0, 103))
        left.set_xlim(left=0)
        grid(left)
        if len(chosen) > 1:
            figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=2, fontsize=5.5)
        _boxes(right, listed, content)
        if tolerance is not None:
            for panel in (left, right):
                panel.axvline(tolerance, color=INK, linewidth=1.0, linestyle=(0, (6, 2)))
    of = "" if len(chosen) == len(cells) else f" of {len(chosen)} of {len(cells)} cells"
    caption = (
        f"The {name} at {question['test_poses']} test poses, in {plural(repetitions, 'trial')} of each cell: share of "
        f"the trials below{of} (left); median, the middle half and 5 to 95 % of the trials (right), the fine bars with "
        "the 95 % confidence bounds of the outer two and of the median."
    )
    if tolerance is not None:
        caption += f" The dashed line is the tolerance, {tolerance:g} mm."
    return Illustration(settle(figure), "errors", "Distribution of the error over trials", caption)


def _boxes(axes: Axes, cells: Sequence[Content], content: Content) -> None:
    """Quantiles of cells, one below the other, with their bounds."""
    for row, cell in enumerate(cells):
        found = cell["judged_mm"]
        values = {name: found[name]["value"] for name in SHOWN}
        if values["p05"] is None:
            continue
        ends = {name: np.inf if value is None else value for name, value in values.items()}
        top = axes.get_xlim()[1]
        high = min(ends["p95"], max(top, ends["p05"] * 20))
        axes.plot([ends["p05"], high], [row, row], color=BLUE, linewidth=1.0)
        axes.plot([ends["p25"], min(ends["p75"], high)], [row, row], color=BLUE, linewidth=4.0, solid_capstyle="butt")
        if values["median"] is not None:
            axes.plot(ends["median"], row, marker="o", color="white", markeredgecolor=BLUE, markersize=3.2)
        for name in ("p05", "median", "p95"):
            if found[name]["value"] is not None and found[name]["high"] is not None:
                axes.plot([found[name]["low"], found[name]["high"]], [row - 0.28] * 2, color=INK, linewidth=0.8)
    axes.set_yticks(range(len(cells)), [escaped(label(cell, content["varied"])) for cell in cells], fontsize=5.5)
    room = max(0, 4 - len(cells)) / 2  # a single row is no tall bar
    axes.set_ylim(len(cells) - 0.4 + room, -0.6 - room)
    axes.set_xlim(left=0)
    axes.set_xlabel(_axis_name(content))
    grid(axes, "x")


def need_figure(content: Content, store: Store) -> Illustration:
    """What the error needs: its quantile by the axis that is a number, or by the share of the trials."""
    axis = next((name for name in ("poses", "size", *content["varied"]) if _is_number(content, name)), None)
    if axis is None:
        return _quantile_figure(content, store)
    question, cells = content["question"], content["cells"]
    others = [other for other in content["varied"] if other != axis]
    whole = groups(cells, others)
    shown = [sorted(whole[i], key=lambda cell: cell["shown"][axis]) for i in _spread(len(whole), MOST)]
    tolerance, name = question["tolerance_mm"], judged_words(question)
    with print_settings():
        figure = sheet(WIDE, 66)
        left, right = figure.subplots(1, 2)
        for k, own in enumerate(shown):
            look: dict[str, Any] = {"color": _COLORS[k], "linestyle": _LINES[k], "marker": _MARKERS[k]}
            look |= {"label": escaped(words(own[0], others))}
            _bars(left, own, axis, "at_share", look)
            if tolerance is None:
                _bars(right, own, axis, "median", look)
            else:
                x = [cell["shown"][axis] for cell in own]
                held = np.array([[cell["within"][b] for b in ("share", "low", "high")] for cell in own]).T * 100
                right.errorbar(x, held[0], [held[0] - held[1], held[2] - held[0]], capsize=1.5, **look)
        share = f"{100 * question['share']:g}"
        varied = _axis_words(axis)
        left.set(xlabel=varied, ylabel=f"{share} % of the trials are below / mm", ylim=(0, None))
        right.set(xlabel=varied)
        if tolerance is None:
            right.set(ylabel="median / mm", ylim=(0, None))
        else:
            right.set(ylabel="trials within the tolerance / %", ylim=(-3, 103))
            left.axhline(tolerance, color=INK, linewidth=1.0, linestyle=(0, (6, 2)))
            right.axhline(100 * question["share"], color=INK, linewidth=1.0, linestyle=(0, (6, 2)))
        for panel in (left, right):
            grid(panel)
        if len(shown) > 1:
            figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=min(len(shown), 3))
    dashed = "" if tolerance is None else f" Dashed: the tolerance, {tolerance:g} mm, and {share} % of the trials."
    second = "the median" if tolerance is None else "the share of the trials within the tolerance"
    caption = (
        f"The {name} that {share} % of the trials stay below, by {varied} (left), and {second} (right); bars "
        f"are 95 % confidence intervals{_unbounded(cells)}.{dashed} "
        + " ".join(f"{answer['text']}." for answer in content["answers"][:2])
    )
    return Illustration(settle(figure), "need", f"The error by {varied}", caption)


def _unbounded(cells: Sequence[Content]) -> str:
    """What to say of bars that end at their value, because so few trials bound it from below only."""
    open_ = any((at := cell["judged_mm"]["at_share"])["high"] is None and at["value"] is not None for cell in cells)
    return ", without an upper end where the trials bound none" if open_ else ""


def _is_number(content: Content, axis: str) -> bool:
    return axis in content["varied"] and isinstance(content["cells"][0]["shown"][axis], int | float)


def _axis_words(axis: str) -> str:
    if axis.startswith("noise_"):
        return f"{axis.removeprefix('noise_')} noise, as the file has it"
    return {"poses": "number of poses", "size": "factor on the true errors"}[axis]


def _bars(axes: Axes, cells: Sequence[Content], axis: str, name: str, look: Mapping[str, Any]) -> None:
    """A quantile of every cell with its bounds; what is infinite is left out."""
    own = [cell for cell in cells if cell["judged_mm"][name]["value"] is not None]
    value = np.array([cell["judged_mm"][name]["value"] for cell in own])
    low = np.array([cell["judged_mm"][name]["low"] for cell in own])
    ends = [cell["judged_mm"][name]["high"] for cell in own]
    high = np.array([at if end is None else end for at, end in zip(value, ends, strict=True)])
    x = [cell["shown"][axis] for cell in own]
    axes.errorbar(x, value, [value - low, high - value], capsize=1.5, **look)


def _quantile_figure(content: Content, store: Store) -> Illustration:
    """Quantiles of the four figures of a trial, where nothing varies that is a number."""
    cells = [content["cells"][i] for i in _spread(len(content["cells"]), MOST)]
    shares = np.array([0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99])
    name = judged_words(content["question"])
    with print_settings():
        figure = sheet(WIDE, 60)
        left, right = figure.subplots(1, 2)
        for k, cell in enumerate(cells):
            values = judged_values(store, cell["cell"], _column(content), content["repetitions"])
            found = [(share, each) for share in shares if np.isfinite((each := quantile(values, share)).value)]
            at = np.array([each.value for _, each in found])
            low = np.array([each.low for _, each in found])
            high = np.array([each.high if np.isfinite(each.high) else each.value for _, each in found])
            look: dict[str, Any] = {"color": _COLORS[k], "linestyle": _LINES[k], "marker": _MARKERS[k]}
            look |= {"label": escaped(label(cell, content["varied"]))}
            left.errorbar([100 * share for share, _ in found], at, [at - low, high - at], capsize=1.5, **look)
        first = store.numbers(cells[0]["cell"], *OF)
        for k, (of, kind) in enumerate(OF.items()):
            look = {"color": _COLORS[k], "linestyle": _LINES[k], "linewidth": 1.1}
            right.hist(first[of], bins=40, histtype="step", label=kind, **look)
        left.set(xlabel="share of the trials / %", ylabel=_axis_name(content), ylim=(0, None))
        right.set(xlabel="error of a trial / mm", ylabel="trials", xlim=(0, None))
        right.legend(fontsize=5.5)
        if len(cells) > 1:
            left.legend(fontsize=5.5)
        for panel in (left, right):
            grid(panel)
    of = "" if len(content["cells"]) == 1 else f", {label(cells[0], content['varied'])}"
    caption = (
        f"The {name} that a share of the trials stay below, with 95 % confidence intervals, without an upper end where "
        "the trials bound none (left); how the mean, rms, 95th percentile and largest error of a trial are "
        f"distributed{of} (right). {content['answers'][0]['text']}."
    )
    return Illustration(settle(figure), "need", "Quantiles of the error", caption)


def coverage_figure(content: Content) -> Illustration:
    """Whether stated 95 % intervals hold the truth in 95 % of the trials, and foretold errors are those found."""
    cells = [cell for cell in content["cells"] if cell["coverage"]]
    names = list(dict.fromkeys(name for cell in cells for name in cell["coverage"]["parameters"]))
    entries: list[tuple[str, Share, bool]] = [("position", pooled([c["coverage"]["position"] for c in cells]), True)]
    for name in names:
        own = [c["coverage"]["parameters"][name] for c in cells if name in c["coverage"]["parameters"]]
        told, untold = pooled([o["held"] for o in own]), pooled([o["held_untold"] for o in own])
        entries.append((name, told if told.of >= untold.of else untold, told.of >= untold.of))
    with print_settings():
        figure = sheet(WIDE, 62)
        left, right = figure.subplots(1, 2, width_ratios=[1.7, 1])
        left.axhline(95, color=INK, linewidth=0.8, linestyle="--")
        for i, (_, share, full) in enumerate(entries):
            if not share.of:
                continue
            bars = [[100 * (share.value - share.low)], [100 * (share.high - share.value)]]
            fill = BLUE if full else "white"
            left.errorbar(i, 100 * share.value, bars, marker="o", color=BLUE, markerfacecolor=fill, capsize=1.5)
        left.set_xticks(
            range(len(entries)), [symbol(n) if n != "position" else n for n, *_ in entries], rotation=90, fontsize=5.5
        )
        left.set_ylabel("stated 95 % intervals that hold / %")
        low = min([100 * share.low for _, share, _ in entries if share.of], default=90.0)
        left.set_ylim(min(90.0, low - 1), 100.6)
        grid(left)
        _ratios(right, cells)
    trials = sum(cell["trials"]["ok"] for cell in cells)
    position = entries[0][1]
    held = f"{number(100 * position.value)} %" if position.of else "none"
    caption = (
        f"Left: in how many of {plural(trials, 'trial')} the stated 95 % interval held the truth, of one component of "
        "the error at one test pose (position; another one in every trial) and of each parameter, with binomial 95 % "
        f"confidence intervals; hollow: of parameters of which the data say less than half. Position: {held}. Right: "
        "rms error over the trials that was found, over the one that the covariances foretold, with twice its standard "
        "error, by cell. Errors that are not drawn with the sizes that the identification takes for plausible need "
        "not be held in 95 %: what is known of them beforehand is then not the truth."
    )
    return Illustration(settle(figure), "coverage", "Whether the stated uncertainties hold", caption)


def _ratios(axes: Axes, cells: Sequence[Content]) -> None:
    """Found over foretold rms of every cell."""
    axes.axhline(1, color=INK, linewidth=0.8, linestyle="--")
    for cell in cells:
        found = cell["expected"]
        error = 2 * (found["ratio_error"] or 0.0)
        axes.errorbar(cell["cell"], found["ratio"], error, marker="o", color=BLUE, capsize=1.5, markersize=2.4)
    axes.set(xlabel="cell", ylabel="rms error found / foretold")
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 0.9), max(high, 1.1))
    axes.set_xlim(cells[0]["cell"] - 0.6 if cells else -0.6, cells[-1]["cell"] + 0.6 if cells else 0.6)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=8, integer=True, min_n_ticks=1))
    grid(axes)
