"""The plan in space: the arm, the poses that are measured, the way between them, and what stands around."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import proj3d  # type: ignore[import-untyped]
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
from numpy.typing import NDArray

from symcal.planning.plan_study import PlanStudy
from symcal.planning.surroundings import EDGES, boxes, field_of_view, planes
from symcal.plots.style import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    RULE,
    VERMILION,
    WIDE,
    Illustration,
    escaped,
    print_settings,
    settle,
    sheet,
)
from symcal.plots.touched import Thing, sign, things
from symcal.words import fixed, listed, plural

Array = NDArray[np.float64]

_ARMS = 6  # poses in which the whole arm is drawn
_AXIS = 0.12  # length of the base's axes, of the scene's size
_LEFT, _RIGHT, _BOTTOM, _TOP = 10.0, 18.0, 11.0, 7.0  # room for labels and legend round the view, mm
_UNDER = {"facecolor": "white", "edgecolor": "none", "pad": 0.4}
_HIGHEST = 112.0  # of the figure, mm
_MM = 25.4
_NAMED = 6  # things that are touched which the legend names
_WAY = 40  # points per segment of the way that are drawn


def plan_in_space(found: PlanStudy) -> Illustration:
    """Tool positions in driving order with the way between them, and the arm at the start and in a few of its poses."""
    planned, arm = found.planned, found.problem.arm
    poses = planned.plan.poses
    tool = _tool(found)
    drawn = np.vstack([planned.start[None], poses[_apart(tool, _ARMS)]])
    touched = _touched(found)
    bodies = _down_to(arm.nodes(drawn), drawn, found, touched)
    with print_settings():
        figure = sheet(WIDE, 104)
        figure.set_layout_engine("none")  # it knows nothing of what a 3-D view leaves empty
        axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
        everything = [tool, *bodies]
        for body in bodies[1:]:
            axes.plot(*body.T, color=FAINT, linewidth=1.1, alpha=0.55, solid_joinstyle="round", zorder=2)
        axes.plot(*bodies[0].T, color=INK, linewidth=2.2, solid_joinstyle="round", zorder=5)
        axes.plot(*bodies[0].T, color="white", linewidth=0.7, solid_joinstyle="round", zorder=5.1)
        _way(axes, found, faint=bool(touched))
        must = planned.required
        for points, style in _looks(found, touched, tool, ~must):
            axes.plot(*points.T, zorder=6, **style)
        axes.plot(
            *tool[must].T,
            linestyle="none",
            marker="s",
            markersize=3.6,
            color=VERMILION,
            markerfacecolor="white",
            zorder=6,
        )
        everything += [*_surroundings(axes, found), *_marked(axes, touched)]
        low, high = _limits(np.vstack(everything))
        _planes(axes, found, low, high)
        _base(axes, found, _AXIS * float((high - low).max()))
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(high - low)
        axes.view_init(elev=18, azim=-64)
        _dress(axes)
        _fill(figure, axes, low, high)
        figure.legend(
            handles=_legend(found, touched), loc="upper center", ncols=5 if len(touched) > 2 else 6, handlelength=2.0
        )
    return Illustration(settle(figure), "plan_in_space", "The plan in space", _caption(found, tool))


def _touched(found: PlanStudy) -> tuple[Thing, ...]:
    """What the postures of the plan touch."""
    return () if found.problem.touches is None else things(found.problem.info.measurement, found.problem.info.setup)


def _down_to(nodes: Array, poses: Array, found: PlanStudy, touched: tuple[Thing, ...]) -> list[Array]:
    """The arm's polylines, shape (k, 3) each, down to what each posture touches."""
    if found.problem.touches is None:
        return list(nodes)
    info, out = found.problem.info, []
    zero = np.zeros(len(info.measurement.parameters))
    for body, q, names in zip(nodes, poses, found.problem.touches(poses), strict=True):
        tips = [t.touched_by(q[None], zero, info.setup) for t in touched if t.name in names.split()]
        out.append(np.vstack([body, *tips[:1]]))
    return out


def _looks(
    found: PlanStudy, touched: tuple[Thing, ...], tool: Array, chosen: NDArray[np.bool_]
) -> list[tuple[Array, dict[str, Any]]]:
    """Tool positions of the chosen poses with their marks: those that touch have that of the thing, hollow."""
    dot: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 3.2, "color": BLUE}
    if found.problem.touches is None:
        return [(tool[chosen], dot)]
    names = [own.split() for own in found.problem.touches(found.planned.plan.poses)]
    looks = []
    for i, thing in enumerate(touched):
        own = np.array([thing.name in each for each in names])
        looks.append((tool[chosen & own], sign(i, hollow=True) | {"markersize": 2.6, "markeredgewidth": 0.6}))
    free = np.array([not each for each in names])
    return [*looks, (tool[chosen & free], dot)]


def _marked(axes: Any, touched: tuple[Thing, ...]) -> list[Array]:
    """What is touched, marked where it roughly is; returns the places."""
    for i, thing in enumerate(touched):
        axes.plot(*thing.place, markersize=7, markeredgecolor="white", zorder=9, **sign(i))
    return [thing.place[None] for thing in touched]


def _apart(points: Array, count: int) -> NDArray[np.intp]:
    """Indices of points that are far from each other, the first the one farthest from the middle."""
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    while len(chosen) < min(count, len(points)):
        distance = np.linalg.norm(points[:, None] - points[chosen][None], axis=2).min(axis=1)
        chosen.append(int(np.argmax(distance)))
    return np.array(chosen, dtype=np.intp)


def _way(axes: Any, found: PlanStudy, *, faint: bool) -> None:
    styles: dict[str, dict[str, Any]] = {
        "line": {"color": BLUE, "linewidth": 0.6, "alpha": 0.9},
        "joint": {"color": ORANGE, "linewidth": 0.6, "linestyle": (0, (3, 1.5)), "alpha": 0.9},
    }
    segments = found.planned.motion.segments
    for kind, style in styles.items():
        chosen = [segment.waypoints for segment in segments if segment.kind == kind]
        if not chosen:
            continue
        shown = np.array([each[np.linspace(0, len(each) - 1, _WAY).astype(int)] for each in chosen])
        paths = found.problem.arm.motion(shown.reshape(-1, shown.shape[2]))[0].reshape(*shown.shape[:2], 3)
        # all ways of a kind as one line with gaps: a line each takes a minute where there are a thousand
        gapped = np.concatenate([paths, np.full((len(paths), 1, 3), np.nan)], axis=1).reshape(-1, 3)
        if faint:  # the ways from one contact to the next are long, and nothing is measured on them
            style |= {"linewidth": 0.35, "alpha": 0.3}
        axes.plot(*gapped.T, zorder=3, **style)


def _surroundings(axes: Any, found: PlanStudy) -> list[Array]:
    """Camera and keep-out boxes; returns their corners."""
    corners = []
    if found.problem.view is not None:
        corners.append(_frustum(axes, field_of_view(found.problem.view, _tool(found))))
    for box in boxes(found.file):
        for i, j in EDGES:
            axes.plot(*box.corners[[i, j]].T, color=VERMILION, linewidth=0.8, zorder=4)
        corners.append(box.corners)
    return corners


def _tool(found: PlanStudy) -> Array:
    return found.problem.arm.motion(found.planned.plan.poses)[0]


def _frustum(axes: Any, field: Array) -> Array:
    """The camera's field of view."""
    corners, eye = field[:4], field[4]
    for corner in corners:
        axes.plot(*np.array([eye, corner]).T, color=GREEN, linewidth=0.8, zorder=4)
    axes.plot(*np.vstack([corners, corners[:1]]).T, color=GREEN, linewidth=1.0, zorder=4)
    axes.plot(*eye, marker="s", markersize=4, color=GREEN, zorder=5)
    return field


def _planes(axes: Any, found: PlanStudy, low: Array, high: Array) -> None:
    """Tables and walls as patches where they cut the scene."""
    for wall in planes(found.file):
        patch = wall.patch(low, high)
        if patch is None:
            continue
        axes.add_collection3d(Poly3DCollection([patch], facecolor=VERMILION, alpha=0.07, zorder=1))


def _base(axes: Any, found: PlanStudy, length: float) -> None:
    frame = found.problem.info.setup.base
    for i, name in enumerate("xyz"):
        end = frame[:3, 3] + length * frame[:3, i]
        axes.plot(*np.array([frame[:3, 3], end]).T, color=INK, linewidth=1.0, zorder=6)
        axes.text(
            *(frame[:3, 3] + 1.25 * length * frame[:3, i]),
            name,
            fontsize=6.5,
            ha="center",
            va="center",
            zorder=7,
            bbox=_UNDER,
        )


def _limits(points: Array) -> tuple[Array, Array]:
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.03 * float((high - low).max())
    return low - margin, high + margin


def _fill(figure: Any, axes: Any, low: Array, high: Array) -> None:
    """Scale the view until the scene's box fills the sheet, and cut the sheet where it would stay empty."""
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    axes.apply_aspect()
    x, y, _ = proj3d.proj_transform(*corners.T, axes.get_proj())
    at = axes.transData.transform(np.column_stack([x, y])) / figure.dpi * _MM
    first, size = at.min(axis=0), np.ptp(at, axis=0)
    width = figure.get_figwidth() * _MM - _LEFT - _RIGHT
    scale = min(width / size[0], (_HIGHEST - _BOTTOM - _TOP) / size[1])
    rect = np.array(axes.get_position(original=True).bounds) * np.tile(figure.get_size_inches() * _MM, 2)
    height = size[1] * scale + _BOTTOM + _TOP
    room = np.array([(width - size[0] * scale) / 2 + _LEFT, _BOTTOM])
    origin = room - (first - rect[:2]) * scale
    sheet_size = np.array([figure.get_figwidth() * _MM, height])
    figure.set_figheight(height / _MM)
    axes.set_position((*(origin / sheet_size), *(rect[2:] * scale / sheet_size)))


def _dress(axes: Any) -> None:
    for axis, name in ((axes.xaxis, "x"), (axes.yaxis, "y"), (axes.zaxis, "z")):
        axis.set_pane_color((1, 1, 1, 0))
        axis._axinfo["grid"].update(color=RULE, linewidth=0.4)
        axis.line.set_color(FAINT)
        axis.set_label_text(f"{name} / mm")
        axis.set_tick_params(pad=-1)
        axis.labelpad = 2
    for name in "xyz":
        axes.locator_params(axis=name, nbins=5)


def _legend(found: PlanStudy, touched: tuple[Thing, ...]) -> list[Line2D]:
    kinds = found.planned.motion.kinds
    hollow: dict[str, Any] = {"markerfacecolor": "white", "color": INK} if touched else {"color": BLUE}
    handles = [Line2D([], [], linestyle="none", marker="o", markersize=3.2, label="pose to measure", **hollow)]
    if found.planned.required.any():
        handles.append(
            Line2D(
                [],
                [],
                linestyle="none",
                marker="s",
                markersize=3.6,
                color=VERMILION,
                markerfacecolor="white",
                label="required",
            )
        )
    if "line" in kinds:
        handles.append(Line2D([], [], color=BLUE, linewidth=0.8, label="straight line of the tool"))
    if "joint" in kinds:
        handles.append(Line2D([], [], color=ORANGE, linewidth=0.8, linestyle=(0, (3, 1.5)), label="joint motion"))
    handles.append(Line2D([], [], color=INK, linewidth=2.2, label="arm at the start"))
    if found.problem.view is not None:
        handles.append(Line2D([], [], color=GREEN, linewidth=1.0, label="camera"))
    for i, thing in enumerate(touched[:_NAMED]):
        handles.append(Line2D([], [], markersize=4, label=escaped(thing.name), **sign(i)))
    constraints = found.file.plan.constraints
    if constraints.keep_out or constraints.planes:
        handles.append(Line2D([], [], color=VERMILION, linewidth=0.8, label="keep out"))
    return handles


def _caption(found: PlanStudy, tool: Array) -> str:
    kinds = found.planned.motion.kinds
    size = tool.max(axis=0) - tool.min(axis=0)
    text = (
        f"{plural(len(tool), 'pose')} of the tool in the world frame, joined in driving order from the start; the arm "
        f"is drawn at the start and, in grey, in {min(_ARMS, len(tool))} of its poses, the letters mark its base "
        f"frame. The tool moves straight in {kinds.count('line')} of {plural(len(kinds), 'segment')}. Its positions "
        f"span {' × '.join(fixed(float(s), 0) for s in size)} mm."
    )
    if found.problem.touches is not None:
        names = [name for names in found.problem.touches(found.planned.plan.poses) for name in names.split()]
        counts = [f"{name} in {plural(count, 'pose')}" for name, count in sorted(Counter(names).items())]
        return f"{text} It touches {listed(counts)}: hollow marks are the tool there, filled ones what is touched."
    where, count = np.unique(tool.round(3), axis=0, return_counts=True)
    if len(where) < len(tool):
        text += (
            f" Several poses put the tool in the same place: there are {len(where)} places, one of them with "
            f"{int(count.max())} poses."
        )
    return text
