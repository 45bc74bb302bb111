"""Errors of the tool: per pose, per axis, and their distribution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from symcal.evaluate import Errors
from symcal.plots.style import (
    FAINT,
    INK,
    LOOKS,
    PARTS,
    RULE,
    WIDE,
    Comparison,
    Illustration,
    grid,
    marks,
    print_settings,
    settle,
    sheet,
)
from symcal.words import listed, number, plural

Array = NDArray[np.float64]

_SHOWN = ("before", "offsets_only", "after")


def errors_per_pose(
    errors: Comparison, labels: Mapping[str, Sequence[str]] | None = None, against: str = "noisy measurement"
) -> Illustration:
    """Position error of every pose (rms over its points), and rotation angle where there is one, before and after.

    Args:
        errors: by part and state; `train` and `test` are drawn side by side in the order of the measurement.
        labels: names of the poses of each part, for the worst one. against: what the errors are taken against.
    """
    parts = [part for part in ("train", "test") if errors.get(part)]
    orientation = all(e.orientation is not None for part in parts for e in errors[part].values())
    with print_settings():
        figure = sheet(WIDE, 100 if orientation else 62)
        rows: list[Axes] = list(figure.subplots(2 if orientation else 1, 1, sharex=True, squeeze=False)[:, 0])
        _per_pose_panel(rows[0], errors, parts, "position")
        several = any(len(np.unique(e.point)) > 1 for part in parts for e in errors[part].values())
        rows[0].set_ylabel(
            "position error per pose / mm" if not several else "position error per pose\n(rms over points) / mm"
        )
        if orientation:
            _per_pose_panel(rows[1], errors, parts, "orientation")
            rows[1].set_ylabel("orientation error per pose / deg")
        rows[-1].set_xlabel("pose, in the order of the measurement")
        _part_titles(rows[0], errors, parts)
        _legend(figure, [s for s in _SHOWN if s in errors[parts[0]]], "lines: rms")
    sentences = []
    for part in parts:
        states = errors[part]
        sentences.append(
            f"{PARTS[part]} poses {_change(states, 'position')}"
            + (f", {_change(states, 'orientation')}" if orientation else "")
        )
    last = parts[-1]
    worst, where = _worst(errors[last]["after"], None if labels is None else labels.get(last))
    caption = (
        f"Tool error against the {against}, pose by pose; horizontal lines are the rms over the part. Rms over {'; '.join(sentences)}. "
        f"The largest position error after the identification is {number(worst)} mm, at {PARTS[last]} pose {where}."
    )
    return Illustration(settle(figure), "errors_per_pose", "Error of every pose", caption)


def residuals_per_axis(errors: Comparison, against: str = "noisy measurement") -> Illustration:
    """Components x, y, z in world of the position error of every observation, before and after."""
    parts = [part for part in ("train", "test") if errors.get(part)]
    names = [s for s in ("before", "after") if s in errors[parts[0]]]
    with print_settings():
        figure = sheet(WIDE, 100)
        axes = figure.subplots(3, 2, sharex="col", sharey=True, width_ratios=[5, 1])
        limit = 1.08 * max(float(np.abs(errors[p][s].vectors).max()) for p in parts for s in names)
        limit = limit or 1.0
        bins = np.linspace(-limit, limit, 42)
        for i, (row, axis) in enumerate(zip(axes, "xyz", strict=True)):
            start = 0.0
            for part in parts:
                for name in names:
                    vectors, look = errors[part][name].vectors, LOOKS[name]
                    at = start + np.arange(len(vectors))
                    row[0].plot(at, vectors[:, i], **marks(look), markersize=_size(errors, parts), zorder=3)
                start += len(errors[part][names[0]].vectors) + _gap(errors, parts)
            for name in names:
                look = LOOKS[name]
                values = np.concatenate([errors[part][name].vectors[:, i] for part in parts])
                row[1].hist(
                    values,
                    bins=bins.tolist(),
                    orientation="horizontal",
                    histtype="step" if look.hollow else "stepfilled",
                    color=look.color,
                    alpha=None if look.hollow else 0.75,
                    linewidth=0.9,
                )
            row[0].set_ylabel(f"error in {axis} / mm")
            for panel in row:
                grid(panel)
                panel.axhline(0, color=INK, linewidth=0.5, zorder=1)
            _separator(row[0], errors, parts, points=True)
        axes[0, 0].set_ylim(-limit, limit)
        axes[0, 0].set_xlim(-1, start)
        axes[2, 0].set_xticks([])
        axes[2, 0].set_xlabel("observation, in the order of the measurement")
        axes[2, 1].set_xlabel("observations")
        _part_titles(axes[0, 0], errors, parts, points=True)
        _legend(figure, names)
    pooled = np.vstack([errors[part]["after"].vectors for part in parts])
    mean, spread = pooled.mean(axis=0), pooled.std(axis=0)
    bias = listed([f"{number(m, 2)} mm in {c}" for m, c in zip(mean, "xyz", strict=True)])
    sigma = listed([f"{number(s, 2)} mm in {c}" for s, c in zip(spread, "xyz", strict=True)])
    caption = (
        f"Components of the position error in world, model minus {against.removeprefix('noisy ')}, over {plural(len(pooled), 'observation')}. After the "
        f"identification their mean is {bias}, their standard deviation {sigma}. A pattern over the poses would be an effect that the model does not "
        "have."
    )
    return Illustration(settle(figure), "residuals_per_axis", "Residuals by axis", caption)


def error_distribution(
    states: Mapping[str, Errors],
    part: str = "test",
    against: str = "noisy measurement",
    name: str = "error_distribution",
) -> Illustration:
    """Histogram and cumulative distribution of the norms of the position error, state by state.

    Args:
        states: errors by state, of one part of the data. part: which one, for the words. name: of the figure's files.
    """
    shown = [s for s in ("before_raw", *_SHOWN) if s in states]
    norms = {s: np.sort(states[s].position) for s in shown}
    top = max(float(v[-1]) for v in norms.values()) or 1.0
    with print_settings():
        figure = sheet(WIDE, 62)
        left, right = figure.subplots(1, 2)
        bins = np.linspace(0, top, 31)
        for s in shown:
            look = LOOKS[s]
            if s in ("before", "after"):
                left.hist(
                    norms[s],
                    bins=bins.tolist(),
                    histtype="step" if look.hollow else "stepfilled",
                    color=look.color,
                    alpha=None if look.hollow else 0.75,
                    linewidth=1.0,
                )
            share = np.arange(1, len(norms[s]) + 1) / len(norms[s])
            right.step(
                np.concatenate([[0.0], norms[s]]),
                100 * np.concatenate([[0.0], share]),
                where="post",
                color=look.color,
                linestyle=look.line,
                linewidth=1.4 if s == "after" else 1.1,
            )
        right.axhline(95, color=FAINT, linewidth=0.5, linestyle=":")
        right.annotate(
            "95 %",
            (top, 95),
            ha="right",
            va="bottom",
            fontsize=6,
            color=FAINT,
            xytext=(0, 1),
            textcoords="offset points",
        )
        left.set(xlabel="position error / mm", ylabel="observations", xlim=(0, top))
        right.set(xlabel="position error / mm", ylabel="observations below / %", xlim=(0, top), ylim=(0, 104))
        for panel in (left, right):
            grid(panel)
        _legend(figure, shown, lines=True)
    count = len(norms["after"])
    truth = part == "truth"
    over = (
        f"{plural(count, 'simulated pose')}, against the truth"
        if truth
        else f"{plural(count, PARTS[part] + ' observation')}, against the {against}"
    )
    sentence = ""
    if "before" in norms:
        better = (
            float(np.mean(states["after"].position < states["before"].position))
            if len(norms["before"]) == count
            else np.nan
        )
        sentence = (
            f" The identification made {number(100 * better, 2)} % of them better." if np.isfinite(better) else ""
        )
    quantiles = listed([f"{number(float(np.percentile(norms[s], 95)))} mm {_phase(s)}" for s in shown])
    caption = f"Position errors of {over}. 95 % of them are below {quantiles}.{sentence}"
    return Illustration(settle(figure), name, f"Distribution of the {'true ' if truth else ''}error", caption)


# ----------------------------------------------------------------------------------------------------------- shared parts


def per_pose(values: Array, pose: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
    """Poses that were seen, and the rms of the values of each."""
    seen, place = np.unique(pose, return_inverse=True)
    return seen, np.sqrt(np.bincount(place, values**2) / np.bincount(place))


def _values(errors: Errors, kind: str) -> Array:
    if kind == "position":
        return per_pose(errors.position, errors.pose)[1]
    assert errors.orientation is not None
    return np.rad2deg(errors.orientation)


def _rms(errors: Errors, kind: str) -> float:
    values = errors.position if kind == "position" else _values(errors, kind)
    return float(np.sqrt(np.mean(values**2)))


def _counts(errors: Comparison, parts: list[str], points: bool = False) -> list[int]:
    return [len(errors[p]["after"].vectors) if points else len(np.unique(errors[p]["after"].pose)) for p in parts]


def _gap(errors: Comparison, parts: list[str], points: bool = True) -> float:
    return max(2.0, 0.02 * sum(_counts(errors, parts, points)))


def _size(errors: Comparison, parts: list[str], points: bool = True) -> float:
    return float(np.clip(3.4 - 0.006 * sum(_counts(errors, parts, points)), 1.4, 3.0))


def _per_pose_panel(axes: Axes, errors: Comparison, parts: list[str], kind: str) -> None:
    start, top = 0.0, 0.0
    for part in parts:
        shown = [s for s in _SHOWN if s in errors[part]]
        values = {s: _values(errors[part][s], kind) for s in shown}
        at = start + np.arange(len(values["after"]))
        if "before" in values:
            axes.vlines(at, values["after"], values["before"], color=RULE, linewidth=0.6, zorder=1)
        for s in shown:
            axes.plot(at, values[s], **marks(LOOKS[s]), markersize=_size(errors, parts, False), zorder=3)
            rms = _rms(errors[part][s], kind)
            axes.hlines(
                rms, at[0] - 0.5, at[-1] + 0.5, color=LOOKS[s].color, linestyle=LOOKS[s].line, linewidth=0.9, zorder=2
            )
            top = max(top, float(values[s].max()))
        start = at[-1] + 1 + _gap(errors, parts, False)
    axes.set_xlim(-1.5, start - _gap(errors, parts, False) + 0.5)
    axes.set_ylim(0, 1.06 * top or 1.0)
    axes.set_xticks([])
    grid(axes)
    _separator(axes, errors, parts)


def _separator(axes: Axes, errors: Comparison, parts: list[str], points: bool = False) -> None:
    if len(parts) == 2:
        first = _counts(errors, parts, points)[0]
        axes.axvline(first - 1 + (1 + _gap(errors, parts, points)) / 2, color=FAINT, linewidth=0.6)


def _part_titles(axes: Axes, errors: Comparison, parts: list[str], points: bool = False) -> None:
    start = 0.0
    counts, poses = _counts(errors, parts, points), _counts(errors, parts)
    for part, count, n in zip(parts, counts, poses, strict=True):
        axes.annotate(
            f"{PARTS[part]}: {plural(n, 'pose')}",
            (start + (count - 1) / 2, 1),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            fontsize=6.5,
        )
        start += count + _gap(errors, parts, points)


def _legend(figure: Figure, names: Sequence[str], note: str = "", lines: bool = False) -> None:
    from matplotlib.lines import Line2D

    handles = []
    for s in names:
        look = LOOKS[s]
        style = marks(look)
        if lines:
            style |= {"linestyle": look.line, "marker": ""}
        elif note:
            style |= {"linestyle": look.line}
        handles.append(
            Line2D([], [], label=look.label, markersize=3.2, linewidth=1.1, **{k: v for k, v in style.items()})
        )
    figure.legend(
        handles=handles, loc="outside upper center", ncols=len(handles), handlelength=2.6 if lines or note else 1.2
    )


def _phase(state: str) -> str:
    return {
        "before_raw": "with nominal numbers and frames",
        "before": "before",
        "offsets_only": "with joint offsets only",
        "after": "after",
    }[state]


def _change(states: Mapping[str, Errors], kind: str) -> str:
    unit = "mm" if kind == "position" else "deg"
    return " → ".join(number(_rms(states[s], kind)) for s in _SHOWN if s in states) + f" {unit}"


def _worst(errors: Errors, labels: Sequence[str] | None) -> tuple[float, str]:
    worst = int(np.argmax(errors.position))
    pose = int(errors.pose[worst])
    label = labels[pose] if labels is not None and pose < len(labels) else str(pose + 1)
    return float(errors.position[worst]), f"'{label}'"
