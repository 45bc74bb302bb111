"""Figures of checks: what the tests say, what a plan finds, and the history over time with its limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from symcal.plots.panels import logarithmic
from symcal.plots.style import (
    BLUE,
    FAINT,
    INK,
    ORANGE,
    RULE,
    VERMILION,
    WIDE,
    Illustration,
    escaped,
    grid,
    print_settings,
    settle,
    sheet,
)
from symcal.units import in_mrad
from symcal.watch.history import Row, numbers
from symcal.watch.words import share, size, verdict
from symcal.words import percent, plural

Content = Mapping[str, Any]
Array = NDArray[np.float64]

_BAND = "#eceff1"  # where nothing is said
_SHORT = {"base": "base", "tool": "tool", "rest": "anything else"}
_ROW, _HEAD = 6.0, 18.0  # mm: a line, and what stands around them
_LARGE = 30.0  # times the noise, from which readings are on a logarithmic axis
_NAMED = 24  # poses of which each has its name below the axis
_IN_ROW = 3  # joints of a history beside each other


def check_figure(content: Content) -> Illustration:
    """Every test over its alarm limit, offsets with their 95 % intervals; and the readings by pose over their noise."""
    rows = [*content["joints"], *(name for name in ("base", "tool", "rest") if name in content["tests"])]
    with print_settings():
        figure = sheet(WIDE, max(_HEAD + _ROW * len(rows), 52.0))
        left, right = figure.subplots(1, 2, width_ratios=[1.75, 1])
        _tests(left, rows, content)
        _poses(right, content)
    title = "What changed" if content["verdict"] == "changed" else "The calibration holds"
    return Illustration(settle(figure), "check", title, _check_caption(content))


def _tests(axes: Axes, rows: Sequence[str], content: Content) -> None:
    named, alarms = {each["name"] for each in content["group"]}, set(content["alarms"])
    axes.axvspan(-1, 1, color=_BAND, linewidth=0, zorder=0)
    axes.axvline(0, color=RULE, linewidth=0.6, zorder=1)
    reach, said = 1.6, []
    for at, name in enumerate(rows):
        joint, test = content["joints"].get(name), content["tests"].get(name)
        color = VERMILION if name in named else ORANGE if name in alarms else BLUE
        if joint is not None:
            middle, half = joint["offset"] / joint["limit"], joint["half_width_95"] / joint["limit"]
            axes.plot([middle - half, middle + half], [at, at], color=color, linewidth=1.4, zorder=3)
            axes.plot(middle, at, marker="o", color=color, markersize=4.2, zorder=4)
            reach, unit = max(reach, abs(middle) + half), in_mrad(joint["unit"])
            said.append(f"{joint['offset'] * unit[1]:+.2f} ± {joint['half_width_95'] * unit[1]:.2f} {unit[0]}")
        elif test is not None and test["limit"]:
            value = math.sqrt(test["squares"] / test["limit"])
            alarm = test["squares"] > test["limit"]
            color = VERMILION if name in named else ORANGE if alarm else BLUE
            axes.plot(value, at, marker="D", color=color, markersize=3.6, zorder=4)
            reach = max(reach, value)
            said.append("")
        else:
            axes.text(0, at, "not seen", color=FAINT, ha="center", va="center", backgroundcolor=_BAND, fontsize=6)
            said.append("")
    numbered = {name: i for i, name in enumerate(content["joints"], start=1)}
    labels = [f"{numbered[name]}  {name}" if name in numbered else _SHORT[name] for name in rows]
    axes.set_yticks(range(len(rows)), [escaped(label) for label in labels])
    for tick, name in zip(axes.get_yticklabels(), rows, strict=True):
        if name in named:
            tick.set(color=VERMILION, fontweight="bold")
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlim(-1.08 * reach, 1.08 * reach)
    axes.tick_params(axis="y", length=0)
    beside = axes.secondary_yaxis("right")
    beside.set_yticks(range(len(rows)), [text.replace("-", "−") for text in said])
    beside.tick_params(axis="y", length=0)
    beside.spines["right"].set_visible(False)
    axes.set_xlabel("change over its alarm limit (grey: no alarm)")
    grid(axes, "x")


def _poses(axes: Axes, content: Content) -> None:
    over, labels = content["over_noise"], content["poses"]
    at = np.arange(len(labels))
    for state, color, face, text in (
        ("before", ORANGE, "white", "by the calibration"),
        ("after", BLUE, BLUE, "with the change"),
    ):
        if state in over:
            look: dict[str, Any] = {"color": color, "markerfacecolor": face, "label": text}
            axes.plot(at, over[state], "o-", linewidth=0.6, markersize=3.6, **look)
    axes.axhline(1, color=INK, linewidth=0.6, linestyle=(0, (4, 3)), zorder=1)
    largest = max(max(values) for values in over.values())
    if largest > _LARGE:
        axes.set_yscale("log")
        logarithmic(axes.yaxis)
    else:
        axes.set_ylim(0, 1.12 * max(1.5, largest))
    if len(labels) <= _NAMED:
        long = max(len(label) for label in labels) > 3
        axes.set_xticks(at, [escaped(label) for label in labels], rotation=90 if long else 0)
    axes.set_xlabel("pose")
    axes.set_ylabel("rms of a reading over the noise")
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, 1.12), ncols=2, handlelength=1.4)
    grid(axes)


def _check_caption(content: Content) -> str:
    return (
        f"{verdict(content)[0].upper()}{verdict(content)[1:]}. Left: offset of every joint if it alone changed, with "
        "its 95 % interval, over the offset at which there is alarm; base, tool and the sum of all squares "
        "(anything else) by the root of their statistic over its limit, which has no sign. Right: the readings of "
        "every pose about the calibrated robot, and with the change that explains them."
    )


def plan_figure(content: Content) -> Illustration:
    """The smallest changes that a plan finds, with the instrument where it was and set up anew."""
    offsets = content["offsets"]
    rows: list[tuple[str, str, float | None, float | None, float | None]] = [
        (f"{each['joint']}  {name}", each["unit"], each["still"], each["moved"], each["wanted"])
        for name, each in offsets.items()
    ]
    for name, sizes in content["frames"]["still"].items():
        for unit, found in sizes.items():
            what = f"{name} {'shift' if unit == 'mm' else 'turn'}"
            rows.append((what, unit, found, content["frames"]["moved"].get(name, {}).get(unit), None))
    with print_settings():
        figure = sheet(WIDE, _HEAD + 4 + _ROW * len(rows))
        axes = figure.subplots()
        sizes = [in_mrad(unit)[1] * x for _, unit, *found in rows for x in found if x is not None]
        for at, (_, unit, still, moved, wanted) in enumerate(rows):
            _dumbbell(axes, at, [None if x is None else x * in_mrad(unit)[1] for x in (still, moved, wanted)])
        axes.set_xscale("log")
        axes.set_xlim(min(sizes) / 1.5, max(sizes) * 1.5)
        logarithmic(axes.xaxis)
        axes.set_yticks(range(len(rows)), [escaped(label) for label, *_ in rows])
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0)
        texts = [f"{_said(still, unit)}   |   {_said(moved, unit)}" for _, unit, still, moved, _ in rows]
        beside = axes.secondary_yaxis("right")
        beside.set_yticks(range(len(rows)), texts)
        beside.tick_params(axis="y", length=0)
        beside.spines["right"].set_visible(False)
        axes.set_xlabel(f"smallest change found with a power of {percent(content['power'])} / mrad, mm")
        grid(axes, "x")
        figure.legend(
            handles=[
                Line2D([], [], color=BLUE, marker="o", linestyle="none", label="instrument not moved"),
                Line2D(
                    [], [], color=ORANGE, marker="o", markerfacecolor="white", linestyle="none", label="set up anew"
                ),
                Line2D([], [], color=VERMILION, marker="|", linestyle="none", markersize=7, label="wanted"),
            ],
            loc="outside upper center",
            ncols=3,
        )
    count = plural(len(content["poses"]), "pose")
    caption = (
        f"Smallest changes that a check at these {count} finds in {percent(content['power'])} of cases, at a false "
        f"alarm in {share(content['alpha'])} of checks, with the calibration as well known as it is; of base and tool "
        "a shift or turn in the direction that is seen least. Numbers: not moved | set up anew."
    )
    return Illustration(settle(figure), "finds", "What the check finds", caption)


def _dumbbell(axes: Axes, at: int, found: Sequence[float | None]) -> None:
    still, moved, wanted = found
    if still is not None and moved is not None:
        axes.plot([still, moved], [at, at], color=RULE, linewidth=2.2, solid_capstyle="butt", zorder=1)
    if wanted is not None:
        axes.plot(wanted, at, marker="|", color=VERMILION, markersize=9, markeredgewidth=1.1, zorder=2)
    if moved is not None:
        axes.plot(moved, at, marker="o", color=ORANGE, markerfacecolor="white", markersize=4.4, zorder=3)
    if still is not None:
        axes.plot(still, at, marker="o", color=BLUE, markersize=4.4, zorder=4)


def _said(value: float | None, unit: str) -> str:
    return "not seen" if value is None else size(value, unit)


def history_figure(rows: list[Row], joints: Sequence[str]) -> Illustration:
    """All checks over time: the largest test over its limit, and the offset of every joint with its limits."""
    when = _when(rows)
    tests = [key for key in dict.fromkeys(k for each in rows for k in each) if key.endswith("_over_limit")]
    over = np.array([np.sqrt(numbers(rows, key)) for key in tests])
    shown = [name for name in joints if any(np.isfinite(numbers(rows, f"{name}_{u}")).any() for u in ("mrad", "mm"))]
    lines = math.ceil(len(shown) / _IN_ROW)
    with print_settings():
        figure = sheet(WIDE, 46 + 34 * lines)
        parts: Any = figure.subfigures(2, 1, height_ratios=[46, max(34 * lines, 1)])
        _largest(parts[0].subplots(), when, np.nanmax(over, axis=0), rows)
        if shown:
            each = parts[1].subplots(lines, _IN_ROW, squeeze=False, sharex=True).ravel()
            for axes, name in zip(each, shown, strict=False):
                _offset(axes, when, name, rows, bottom=True)
            for axes in each[len(shown) :]:
                axes.set_visible(False)
    bad = sum(each["verdict"] != "holds" for each in rows)
    caption = (
        f"{plural(len(rows), 'check')}, {bad} of them with a change. Above: the largest of all tests over its alarm "
        "limit. Below: the offset of each joint if it alone changed; grey: no alarm."
    )
    return Illustration(settle(figure), "history", "History of checks", caption)


def _when(rows: list[Row]) -> Array:
    """Dates as matplotlib counts them; numbers of the checks where one is no date."""
    try:
        found = [datetime.fromisoformat(str(each["date"])).replace(tzinfo=None) for each in rows]
        return np.array(date2num(found))  # type: ignore[no-untyped-call]
    except ValueError:
        return np.arange(1.0, len(rows) + 1)


def _largest(axes: Axes, when: Array, largest: Array, rows: list[Row]) -> None:
    bad = np.array([each["verdict"] != "holds" for each in rows])
    top = 1.35 * max(float(np.nanmax(largest)), 1.0)
    low = min(float(np.nanmin(largest)) / 1.4, 0.4)
    axes.axhspan(low, 1, color=_BAND, linewidth=0, zorder=0)
    axes.axhline(1, color=INK, linewidth=0.6, linestyle=(0, (4, 3)))
    axes.plot(when, largest, color=RULE, linewidth=0.8, zorder=2)
    axes.plot(when[~bad], largest[~bad], "o", color=BLUE, markersize=3.6, zorder=3, label="holds")
    axes.plot(when[bad], largest[bad], "D", color=VERMILION, markersize=4.2, zorder=4, label="changed")
    before = ""
    for at, value, each in zip(when, largest, rows, strict=True):
        what = str(each["what"]) if each["verdict"] != "holds" else ""
        if what and what != before:
            axes.annotate(
                escaped(what),
                (at, value),
                xytext=(-3, 4),
                textcoords="offset points",
                ha="right",
                color=VERMILION,
                fontsize=6,
            )
        before = what
    axes.set_yscale("log")
    axes.set_ylim(low, top)
    logarithmic(axes.yaxis)
    axes.set_ylabel("largest test over\nits alarm limit")
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, 1.16), ncols=2)
    _dates(axes, when)
    grid(axes)


def _offset(axes: Axes, when: Array, name: str, rows: list[Row], *, bottom: bool) -> None:
    unit = "mrad" if np.isfinite(numbers(rows, f"{name}_mrad")).any() else "mm"
    offset, limit = numbers(rows, f"{name}_{unit}"), numbers(rows, f"{name}_limit_{unit}")
    axes.fill_between(when, -limit, limit, step="mid", color=_BAND, linewidth=0, zorder=0)
    axes.axhline(0, color=RULE, linewidth=0.6, zorder=1)
    alarm = np.abs(offset) > limit
    axes.plot(when, offset, color=FAINT, linewidth=0.6, zorder=2)
    axes.plot(when[~alarm], offset[~alarm], "o", color=BLUE, markersize=2.8, zorder=3)
    axes.plot(when[alarm], offset[alarm], "D", color=ORANGE, markersize=3.0, zorder=4)
    named = np.array([name in str(each["what"]).split(" or ") for each in rows])
    axes.plot(when[named], offset[named], "D", color=VERMILION, markersize=3.4, zorder=5)
    axes.set_title(escaped(name))
    axes.set_ylabel(f"offset / {unit}")
    axes.yaxis.set_major_locator(MaxNLocator(4))
    if bottom:
        _dates(axes, when)
    grid(axes)


def _dates(axes: Axes, when: Array) -> None:
    span = float(np.ptp(when)) or 1.0
    axes.set_xlim(when.min() - 0.04 * span, when.max() + 0.04 * span)
    if when.max() > 1000:  # days since 1970
        locator = AutoDateLocator(minticks=3, maxticks=6)  # type: ignore[no-untyped-call]
        axes.xaxis.set_major_locator(locator)
        axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    else:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel("check")
