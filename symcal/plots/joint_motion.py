"""How every joint moves from pose to pose."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from symcal.planning.plan_study import PlanStudy
from symcal.plots.style import (
    BLUE,
    FAINT,
    ORANGE,
    VERMILION,
    WIDE,
    Illustration,
    escaped,
    grid,
    print_settings,
    settle,
    sheet,
)
from symcal.words import number, plural

Array = NDArray[np.float64]

_PANEL = 15.0  # height of a joint's panel, mm
_CLOSE = 1e-3  # of the range: a reading so near to its limit counts as on it


def joint_motion(found: PlanStudy) -> Illustration:
    """Joint readings over the number of the pose, on the way too, with the limits of the working area."""
    robot, planned, area = found.problem.robot, found.planned, found.problem.area
    poses, must = planned.plan.poses, planned.required
    numbers = np.arange(1, len(poses) + 1)
    ways = [_ways(found, straight) for straight in (True, False)]
    with print_settings():
        figure = sheet(WIDE, 12 + _PANEL * robot.dof)
        rows = figure.subplots(robot.dof, 1, sharex=True, squeeze=False)[:, 0]
        for j, (axes, joint) in enumerate(zip(rows, robot.joints, strict=True)):
            factor = 180 / np.pi if joint.revolute else 1.0
            for limit in (area.lower[j], area.upper[j]):
                axes.axhline(limit * factor, color=FAINT, linewidth=0.7, linestyle=(0, (4, 2)))
            for x, readings, straight in ways:
                axes.plot(
                    x,
                    readings[:, j] * factor,
                    color=BLUE if straight else ORANGE,
                    linewidth=0.7,
                    linestyle="-" if straight else (0, (3, 1.5)),
                    zorder=2,
                )
            axes.plot(numbers, poses[:, j] * factor, linestyle="none", marker="o", markersize=2.4, color=BLUE, zorder=3)
            axes.plot(
                numbers[must],
                poses[must, j] * factor,
                linestyle="none",
                marker="s",
                markersize=3.4,
                color=VERMILION,
                markerfacecolor="white",
                zorder=4,
            )
            low, high = area.lower[j] * factor, area.upper[j] * factor
            margin = 0.12 * (high - low)
            axes.set_ylim(low - margin, high + margin)
            axes.yaxis.set_major_locator(MaxNLocator(nbins=3, steps=[1, 2, 3, 4.5, 5, 9, 10]))
            axes.set_ylabel(f"{escaped(joint.name)}\n/ {'deg' if joint.revolute else 'mm'}")
            grid(axes)
        rows[-1].set_xlim(-0.4, len(poses) + 0.4)
        rows[-1].xaxis.set_major_locator(MaxNLocator(nbins=12, integer=True))
        rows[-1].set_xlabel("pose, in driving order (0: the start)")
        figure.align_ylabels()
    return Illustration(settle(figure), "joint_motion", "Joint motion", _caption(found))


def _ways(found: PlanStudy, straight: bool) -> tuple[Array, Array, bool]:
    """All ways of one kind as one line with gaps (NaN), which draws like one line each and takes a fraction of the
    time: the number of the pose, shape (K,), and the readings, shape (K, dof)."""
    x, readings = [np.zeros(0)], [np.zeros((0, found.problem.robot.dof))]
    for i, segment in enumerate(found.planned.motion.segments):
        if (segment.kind == "line") == straight:
            span = segment.times[-1] or 1.0
            x += [i + segment.times / span, np.full(1, np.nan)]
            readings += [segment.waypoints, np.full((1, segment.waypoints.shape[1]), np.nan)]
    return np.concatenate(x), np.concatenate(readings), straight


def _caption(found: PlanStudy) -> str:
    planned, area = found.planned, found.problem.area
    poses = planned.plan.poses
    near = np.minimum(poses - area.lower, area.upper - poses) <= _CLOSE * area.span
    motion = planned.motion
    text = (
        "Readings of every joint at the poses (dots) and on the way between them: solid where the tool moves straight, "
        "dashed where the joints move linearly. Grey lines are the limits of the working area, where "
        f"{number(100 * float(near.mean()), 2)} % of all readings are: extreme poses tell most."
    )
    if planned.timed:
        slowest = max(segment.time for segment in motion.segments)
        text += (
            f" At full joint speeds the whole way takes {number(motion.total_time)} s, the longest of "
            f"{plural(len(motion.segments), 'segment')} {number(slowest)} s."
        )
    return text
