"""Arms, cameras and tool paths in three dimensions, drawn for print."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection  # type: ignore[import-untyped]
from numpy.typing import NDArray

from symcal.camera.camera import Camera, rays
from symcal.plots.style import FAINT, INK, RULE, VERMILION

Array = NDArray[np.float64]

_METRES = 1e-3


def space_axes(
    figure: Figure,
    where: SubplotSpec | tuple[int, int, int],
    corners: Array,
    *,
    elevation: float = 22.0,
    azimuth: float = -58.0,
    zoom: float = 1.0,
) -> Any:
    """Axes in metres with equal scales around everything that will be drawn.

    Args:
        corners: points that must be inside, shape (k, 3), mm. elevation, azimuth: of the eye, deg.
    """
    place = where if isinstance(where, tuple) else (where,)
    axes: Any = figure.add_subplot(*place, projection="3d")
    low, high = corners.min(axis=0) * _METRES, corners.max(axis=0) * _METRES
    margin = 0.04 * float(np.max(high - low))
    low, high = low - margin, high + margin
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=zoom)
    axes.set_proj_type("ortho")
    axes.view_init(elev=elevation, azim=azimuth)
    for axis, label, span in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", high - low, strict=True):
        axis.set_pane_color((1, 1, 1, 0))
        axis.line.set_color(FAINT)
        axis._axinfo["grid"].update(color=RULE, linewidth=0.3)
        axis.set_major_locator(_ticks(float(span), float(np.max(high - low))))
        axis.set_tick_params(pad=-3, labelsize=6)
        axis.set_label_text(f"{label} / m")
        axis.labelpad = -8
    return axes


def _ticks(span: float, longest: float) -> Any:
    from matplotlib.ticker import MultipleLocator

    step = 0.5 if longest <= 2.6 else 1.0
    return MultipleLocator(step if span >= step else step / 2)


def draw_arm(axes: Any, nodes: Array, *, color: str = INK, width: float = 2.2) -> None:
    """The polyline through an arm's links.

    Args:
        nodes: its corners from base to tool, shape (k, 3), mm.
    """
    p = _distinct(nodes)
    draw_way(axes, p, color=color, linewidth=width, solid_capstyle="round", zorder=6)
    draw_points(axes, p[:-1], marker="o", markersize=2.4, markerfacecolor="white", color=color, zorder=7)


def _distinct(nodes: Array) -> Array:
    """Corners without the ones that stand on the one before."""
    apart = np.linalg.norm(np.diff(nodes, axis=0), axis=1) > 1e-6
    kept: Array = nodes[np.concatenate([[True], apart])]
    return kept


def draw_camera(axes: Any, camera: Camera, T_world_camera: Array, depth: float, color: str = VERMILION) -> None:
    """A camera as the pyramid that it sees, up to a depth in mm."""
    corner = np.array([[0, 0], [camera.width, 0], [camera.width, camera.height], [0, camera.height]], dtype=np.float64)
    ends = depth * np.column_stack([rays(camera, corner), np.ones(4)])
    world = (ends @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]) * _METRES
    eye = T_world_camera[:3, 3] * _METRES
    beams = Line3DCollection([np.stack([eye, end]) for end in world], colors=color, linewidths=0.5, linestyles="--")
    field = Poly3DCollection([world], facecolors=[(*to_rgb(color), 0.08)], edgecolors=color, linewidths=0.5)
    for collection in (beams, field):
        collection.set_clip_on(False)
        collection.set_in_layout(False)
        axes.add_collection3d(collection)
    draw_points(axes, T_world_camera[None, :3, 3], marker="s", markersize=4.5, color=color, zorder=8)


def draw_points(axes: Any, points: Array, **style: Any) -> None:
    """Markers at points, shape (k, 3), mm."""
    draw_way(axes, points, linestyle="none", **style)


def draw_way(axes: Any, points: Array, **style: Any) -> None:
    """A line through points, shape (k, 3), mm; not cut off where the axes are zoomed into."""
    (line,) = axes.plot(*(points * _METRES).T, clip_on=False, **style)
    line.set_in_layout(False)


def draw_face(axes: Any, corners: Array, color: str) -> None:
    """A flat polygon, shape (k, 3), mm."""
    axes.add_collection3d(
        Poly3DCollection([corners * _METRES], facecolors=color, edgecolors=INK, linewidths=0.5, alpha=0.85)
    )


def draw_label(axes: Any, point: Array, words: str) -> None:
    """Words above a point, shape (3,), mm."""
    text = axes.text(*(point * _METRES), words, fontsize=6.5, ha="center", va="bottom", zorder=9)
    text.set_in_layout(False)
