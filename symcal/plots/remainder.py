"""What a smooth remainder is worth on held-out poses, and where it displaces the tool."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from symcal.calibration.calibrate import Calibration
from symcal.data.dataset import Dataset
from symcal.fit.remainder import Trial
from symcal.plots.style import (
    BLUE,
    FAINT,
    INK,
    NARROW,
    WIDE,
    Illustration,
    escaped,
    grid,
    print_settings,
    settle,
    sheet,
)
from symcal.words import number, percent


def remainder(calibration: Calibration, data: Dataset) -> Illustration:
    """Held-out errors of every training pose with the remainder over those without; where one was kept, beside it its
    size at the training poses over the two joints that it changes most with.

    Raises:
        ValueError: none was tried.
    """
    tried = calibration.trial
    if tried is None:
        raise ValueError("no remainder was tried")
    with print_settings():
        figure = sheet(WIDE if tried.kept else NARROW, 70)
        left, *others = figure.subplots(1, 2 if tried.kept else 1, squeeze=False)[0]
        _paired(left, tried)
        caption = _caption(tried)
        if tried.kept:
            caption += _field(figure, others[0], calibration, data.part("train"))
    return Illustration(settle(figure), "remainder", "A smooth remainder", caption)


def _paired(axes: Axes, tried: Trial) -> None:
    top = 1.05 * float(max(tried.without.max(), tried.given.max()))
    axes.plot([0, top], [0, top], color=INK, linewidth=0.6, linestyle="--", zorder=1)
    axes.plot(tried.without, tried.given, linestyle="none", marker="o", color=BLUE, markersize=1.8, alpha=0.6, zorder=2)
    axes.set_xlim(0, top)
    axes.set_ylim(0, top)
    axes.set_aspect("equal")
    axes.set_xlabel("held-out error without / mm")
    axes.set_ylabel("held-out error with / mm")
    grid(axes, "both")


def _caption(tried: Trial) -> str:
    rms = [number(float(np.sqrt(np.mean(each**2)))) for each in (tried.without, tried.given)]
    below = percent(float(np.mean(tried.given < tried.without)))
    return (
        f"Errors of {len(tried.given)} training poses, each predicted by an identification without it, with a smooth "
        f"remainder over those without. Below the dashed line it helped: {below} of the poses. Held-out rms {rms[0]} "
        f"mm without and {rms[1]} mm with it; it was {'kept' if tried.kept else 'not kept'}."
    )


def _field(figure: Figure, axes: Axes, calibration: Calibration, train: Dataset) -> str:
    robot = calibration.model.robot
    field = robot.remainder
    assert field is not None
    lengths = field.kernel.lengths / np.maximum(np.ptp(train.q, axis=0), 1e-9)
    first, second = np.sort(np.argsort(lengths, kind="stable")[:2]) if robot.dof > 1 else (0, 0)
    size = np.linalg.norm(field.displacement(train.q), axis=1)
    units = [(np.degrees, "deg") if joint.revolute else (np.asarray, "mm") for joint in robot.joints]
    shown = axes.scatter(
        units[first][0](train.q[:, first]), units[second][0](train.q[:, second]), c=size, s=5, cmap="cividis", zorder=2
    )
    names = [escaped(joint.name) for joint in robot.joints]
    axes.set_xlabel(f"{names[first]} / {units[first][1]}")
    axes.set_ylabel(f"{names[second]} / {units[second][1]}")
    axes.set_facecolor("white")
    axes.tick_params(color=FAINT)
    figure.colorbar(shown, ax=axes, label="displacement / mm")
    return (
        f" Right: how far the remainder displaces the tool at the training poses, {number(float(size.max()))} mm at "
        f"most, over the two joints that it changes fastest with."
    )
