"""The paper's Fig. 5, 6 and 8: plans as tours in space and joint by joint, and the test data."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from symcal.paper.plots.looks import PLANS
from symcal.paper.results import Study, StudyPlan
from symcal.paper.surroundings import at_limits
from symcal.plots.space import draw_arm, draw_camera, draw_points, draw_way, space_axes
from symcal.plots.style import (
    FAINT,
    INK,
    NARROW,
    RULE,
    WIDE,
    Illustration,
    grid,
    marks,
    print_settings,
    settle,
    sheet,
)
from symcal.words import number, plural

Array = NDArray[np.float64]

_DRAWN = 400  # points of a tour that are drawn


def trajectories(study: Study, names: tuple[str, str]) -> Illustration:
    """Two plans as tours of the tool, with the arm at the initial pose and the camera."""
    setting = study.setting
    nodes, eye = setting.arm.nodes(setting.start[None])[0], setting.view.T_world_camera[:3, 3]
    plans = [study.plans[name] for name in names]
    around = np.vstack([nodes, eye[None], *(plan.trace for plan in plans)])
    with print_settings():
        figure = sheet(WIDE, 64)
        cells = figure.add_gridspec(1, 2)
        for i, plan in enumerate(plans):
            look = PLANS[plan.name]
            axes = space_axes(figure, cells[i], around, azimuth=-60.0, elevation=20.0, zoom=1.45)
            draw_way(axes, _thinned(plan.trace), color=FAINT, linewidth=0.5, zorder=2)
            draw_points(axes, plan.positions, marker=look.marker, markersize=2.2, color=look.color, zorder=5)
            draw_arm(axes, nodes)
            draw_camera(axes, setting.view.camera, setting.view.T_world_camera, 500.0)
            axes.set_title(f"{'ab'[i]}  {plan.title}", y=0.97)
    words = []
    for plan in plans:
        lines = plan.motion.kinds.count("line")
        words.append(
            f"{plan.title}: {lines} of {len(plan.motion.kinds)} pieces are straight lines of the tool, the rest joint "
            f"motions where the arm cannot follow a line; {number(plan.motion.total_time)} s"
        )
    caption = (
        f"Two plans of {plural(len(plans[0].poses), 'pose')}, driven from the initial pose (arm) as the shortest tour "
        f"found; square: camera. {words[0][0].upper()}{'; '.join(words)[1:]}."
    )
    return Illustration(settle(figure), "paper_trajectory", "Trajectories (paper: Fig. 5)", caption)


def _thinned(trace: Array) -> Array:
    step = max(len(trace) // _DRAWN, 1)
    return np.vstack([trace[::step], trace[-1:]])


def joint_motion(study: Study, names: tuple[str, str]) -> Illustration:
    """Every joint against the point number, on the way too, within its range."""
    setting = study.setting
    joints, area = setting.model.robot.joints, setting.info.area
    with print_settings():
        figure = sheet(WIDE, 88)
        panels: Any = figure.subplots(len(joints), 2, sharex=True, sharey="row")
        for column, name in enumerate(names):
            plan = study.plans[name]
            look = PLANS[name]
            along, way = _timeline(plan)
            for row, joint in enumerate(joints):
                axes = panels[row, column]
                factor, unit = (180 / np.pi, "°") if joint.revolute else (1.0, "mm")
                for limit in (area.lower[row], area.upper[row]):
                    axes.axhline(limit * factor, color=INK, linewidth=0.5, linestyle=":")
                axes.plot(along, way[:, row] * factor, color=FAINT, linewidth=0.6)
                axes.plot(
                    np.arange(1, len(plan.poses) + 1), plan.poses[:, row] * factor, **marks(look) | {"markersize": 2.2}
                )
                axes.yaxis.set_major_locator(MaxNLocator(nbins=3))
                axes.margins(y=0.12)
                grid(axes)
                if column == 0:
                    axes.set_ylabel(f"{joint.name}\n{'θ' if joint.revolute else 'd'}{'₁₂₃₄₅₆₇₈₉'[row]} / {unit}")
            panels[0, column].set_title(f"{'ab'[column]}  {plan.title}")
            panels[-1, column].set_xlabel("point number (0: initial pose)")
        figure.align_ylabels()
    shares = [at_limits(study, study.plans[name].poses) for name in names]
    caption = (
        "Joint readings at the points (marks) and on the way between them (line); dotted: the working area. "
        f"{PLANS[names[0]].label[0].upper()}{PLANS[names[0]].label[1:]}: {number(100 * shares[0], 2)} % of all "
        f"readings are at an end of their range; {PLANS[names[1]].label}: {number(100 * shares[1], 2)} %. What tells "
        "most about the parameters is far out."
    )
    return Illustration(settle(figure), "paper_joint_motion", "Joint motion (paper: Fig. 6)", caption)


def _timeline(plan: StudyPlan) -> tuple[Array, Array]:
    """Point numbers and readings along a tour."""
    x, q = [], []
    for i, segment in enumerate(plan.motion.segments):
        step = max(len(segment.waypoints) // 24, 1)
        span = segment.time or 1.0
        x.append(i + segment.times[::step] / span)
        q.append(segment.waypoints[::step])
    return np.concatenate(x), np.concatenate(q)


def test_data(study: Study) -> Illustration:
    """Where the test poses put the tool, and how far off the nominal robot is there."""
    setting = study.setting
    nodes = setting.arm.nodes(setting.start[None])[0]
    points, off = setting.test_positions, setting.before_raw
    with print_settings():
        figure = sheet(NARROW, 74)
        axes = space_axes(figure, (1, 1, 1), np.vstack([nodes, points]), zoom=1.2)
        cloud = axes.scatter(
            *(points * 1e-3).T, c=off, cmap="cividis", s=2.2, linewidths=0, depthshade=False, rasterized=False
        )
        draw_arm(axes, nodes)
        bar = figure.colorbar(cloud, ax=axes, orientation="horizontal", shrink=0.6, aspect=28, pad=0.02)
        bar.set_label("error of the nominal robot / mm")
        bar.outline.set_linewidth(0.4)
        bar.outline.set_edgecolor(RULE)
    found = study.before_raw
    caption = (
        f"Positions of the tool at {plural(len(points), 'test pose')}, drawn at random over the working area, with the "
        f"arm at the initial pose. Uncalibrated, the robot is off by {number(found.mean)} mm in the mean and "
        f"{number(found.max)} mm at most, against truth."
    )
    return Illustration(settle(figure), "paper_test_data", "Test data (paper: Fig. 8)", caption)
