"""Residuals against the reading of each joint: whether they follow one of them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from symcal.calibration.model_check import ModelCheck
from symcal.plots.panels import marker_size
from symcal.plots.style import (
    FAINT,
    INK,
    LOOKS,
    VERMILION,
    WIDE,
    Illustration,
    escaped,
    grid,
    marks,
    print_settings,
    settle,
    sheet,
)
from symcal.robot.robot import Robot
from symcal.units import in_mrad
from symcal.words import listed, number, plural

Array = NDArray[np.float64]

_COLUMNS = 3
_SHARE, _FEWEST = 8, 5  # of the poses, and poses, that a running mean is taken over


def residuals_by_joint(check: ModelCheck, robot: Robot) -> Illustration | None:
    """Residuals of the training poses along what each joint moves, over its reading; None where none is to be drawn."""
    joints = [i for i in range(check.along.shape[1]) if np.isfinite(check.along[:, i]).sum() > _FEWEST]
    if not joints:
        return None
    unit, factor = in_mrad(check.unit)
    rows = -(-len(joints) // _COLUMNS)
    along = check.along * factor
    limit = 1.08 * float(np.nanmax(np.abs(along[:, joints]))) or 1.0
    with print_settings():
        figure = sheet(WIDE, 12 + 32 * rows)
        axes = figure.subplots(rows, min(_COLUMNS, len(joints)), sharey=True, squeeze=False)
        for panel, i in zip(axes.flat, joints, strict=False):
            turns = robot.joints[i].revolute
            reading = np.rad2deg(check.q[:, i]) if turns else check.q[:, i]
            wave = check.explained.get(i + 1)
            _draw(panel, reading, along[:, i], None if wave is None else wave * factor)
            panel.set_xlabel(f"reading of {escaped(_called(robot, i))} / {'deg' if turns else 'mm'}")
        for panel in axes.flat[len(joints) :]:
            panel.set_visible(False)
        axes[0, 0].set_ylim(-limit, limit)
        for panel in axes[:, 0]:
            panel.set_ylabel(f"residual along\nthe joint / {unit}")
        _legend(figure, bool(check.explained))
    return Illustration(settle(figure), "residuals_by_joint", "Residuals by joint", _caption(check, unit, factor))


def _called(robot: Robot, i: int) -> str:
    name = robot.joints[i].name
    return f"joint {i + 1}" if name in ("", f"q{i + 1}", f"joint_{i + 1}") else f"joint {i + 1} ({name})"


def _draw(axes: Axes, reading: Array, values: Array, wave: Array | None) -> None:
    seen = np.flatnonzero(np.isfinite(values))
    order = seen[np.argsort(reading[seen])]
    width = max(len(order) // _SHARE, _FEWEST)
    at = _running(reading[order], width)
    axes.axhline(0, color=FAINT, linewidth=0.5, zorder=1)
    axes.plot(reading[order], values[order], **marks(LOOKS["after"]), markersize=marker_size([len(order)]), alpha=0.55)
    axes.plot(at, _running(values[order], width), color=INK, linewidth=1.3, zorder=4)
    if wave is not None:
        axes.plot(at, _running(wave[order], width), color=VERMILION, linewidth=1.6, linestyle="--", zorder=5)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=5))
    grid(axes)


def _running(values: Array, width: int) -> Array:
    """Mean over so many neighbours."""
    return np.convolve(values, np.full(width, 1 / width), mode="valid")


def _legend(figure: Figure, waves: bool) -> None:
    handles = [
        Line2D([], [], label="training pose", **(marks(LOOKS["after"]) | {"markersize": 3.2})),
        Line2D([], [], color=INK, linewidth=1.3, label="running mean"),
    ]
    if waves:
        handles.append(Line2D([], [], color=VERMILION, linewidth=1.6, linestyle="--", label="of it, a fitted wave"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), handlelength=2.4)


def _caption(check: ModelCheck, unit: str, factor: float) -> str:
    """One sentence: what is shown, and whether a mean follows a reading."""
    seen = int(np.isfinite(check.along).any(axis=1).sum())
    followed = sorted({cause.joint for cause in check.causes if cause.joint})
    rms = number(float(np.sqrt(np.nanmean(check.along**2))) * factor, 2)
    verdict = (
        "no mean follows a reading by more than chance" if not followed else f"they follow joint {_list(followed)}"
    )
    return (
        f"Component of the {check.group} residual along the motion that each joint would give the reading, over the "
        f"joint's reading, of {plural(seen, 'training pose')} ({rms} {unit} rms), with running means: {verdict}."
    )


def _list(joints: list[int]) -> str:
    return listed([str(joint) for joint in joints])
