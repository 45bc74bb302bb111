"""Groups of joint terms: what each gains, and held-out errors without and with it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from symcal.plots.style import BLUE, FAINT, INK, ORANGE, WIDE, Illustration, grid, print_settings, settle, sheet
from symcal.report.extension import group_words
from symcal.words import listed, number

_ROW, _HEAD = 7.0, 24.0  # mm


def beyond_geometry(facts: Mapping[str, Any]) -> Illustration:
    """Twice the gain in log marginal likelihood of every group, and the rms of poses in folds without and with it.

    Args:
        facts: `extension` of results.json.
    """
    names = list(facts["groups"])
    groups = [facts["groups"][name] for name in names]
    at = np.arange(len(names))[::-1]
    with print_settings():
        figure = sheet(WIDE, _HEAD + _ROW * len(names))
        left, right = figure.subplots(1, 2, sharey=True)
        _gains(left, at, groups, facts["enough"])
        _errors(right, at, groups, facts)
        left.set_yticks(at, [group_words(name) for name in names])
        left.set_ylim(-0.6, len(names) - 0.4)
        handles = [
            Patch(facecolor=BLUE, edgecolor=BLUE, label="kept"),
            Patch(facecolor="white", edgecolor=FAINT, label="left out"),
            Line2D([], [], color=INK, linestyle="--", linewidth=0.6, label="enough to keep it"),
            Line2D([], [], color=ORANGE, marker="o", markerfacecolor="white", linestyle="none", label="without"),
            Line2D([], [], color=BLUE, marker="o", linestyle="none", label="with it"),
        ]
        figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return Illustration(settle(figure), "beyond_geometry", "Beyond geometry", _caption(facts))


def _gains(axes: Axes, at: np.ndarray, groups: list[Mapping[str, Any]], enough: float) -> None:
    gains = [max(group["gain"], 0.0) for group in groups]
    for y, gain, group in zip(at, gains, groups, strict=True):
        face, edge = (BLUE, BLUE) if group["kept"] else ("white", FAINT)
        axes.barh(y, gain, height=0.6, facecolor=face, edgecolor=edge, linewidth=0.6, zorder=3)
        axes.annotate(
            number(gain, 2), (gain, y), xytext=(3, 0), textcoords="offset points", va="center", fontsize=6, zorder=4
        )
    axes.axvline(enough, color=INK, linewidth=0.6, linestyle="--", zorder=2)
    axes.set_xscale("symlog", linthresh=enough, linscale=0.6)
    axes.set_xlim(0, 3 * max(*gains, 2 * enough))
    ticks = [tick for tick in (0, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000) if tick < axes.get_xlim()[1]]
    axes.set_xticks(ticks, [f"{tick}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel("twice the gain in log marginal likelihood")
    grid(axes, "x")


def _errors(axes: Axes, at: np.ndarray, groups: list[Mapping[str, Any]], facts: Mapping[str, Any]) -> None:
    for y, group in zip(at, groups, strict=True):
        without, with_ = group["held_out_rms_without"], group["held_out_rms_with"]
        axes.plot([without, with_], [y, y], color=FAINT, linewidth=0.8, zorder=2)
        axes.plot(without, y, color=ORANGE, marker="o", markerfacecolor="white", zorder=3)
        axes.plot(with_, y, color=BLUE, marker="o", zorder=4)
    axes.set_xlabel(f"held-out {facts['quantity']} error, rms / {facts['unit']}")
    axes.tick_params(axis="y", length=0)
    axes.margins(x=0.08)
    grid(axes, "x")


def _caption(facts: Mapping[str, Any]) -> str:
    kept = [group_words(name) for name in facts["kept"]]
    rms, unit = facts["held_out_rms"], facts["unit"]
    return (
        "Left: what each group of joint terms gains beside the others; a group that was left out, when it was. Right: "
        f"rms over the {facts['poses']} training poses, held out in {facts['folds']} folds, without and with the group "
        f"beside the kept ones. {'Kept: ' + listed(kept) if kept else 'None was kept'}; geometry alone "
        f"{number(rms['geometry'])} {unit}, with what was kept {number(rms['kept'])} {unit}."
    )
