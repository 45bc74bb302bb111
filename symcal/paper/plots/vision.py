"""The paper's Fig. 3: camera, target and arm, and what the camera sees."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.patches import Polygon, Rectangle
from numpy.typing import NDArray

from symcal.paper.plans import camera_sees
from symcal.paper.plots.looks import PLANS
from symcal.paper.results import Setting, Study
from symcal.plots.space import draw_arm, draw_camera, draw_face, draw_label, draw_points, space_axes
from symcal.plots.style import BLUE, FAINT, INK, WIDE, Illustration, grid, print_settings, settle, sheet
from symcal.words import number, plural

Array = NDArray[np.float64]


def vision(study: Study, plan: str) -> Illustration:
    """The scene in space, and the target's image at the poses of a plan."""
    setting, poses = study.setting, study.plans[plan].poses
    sees = camera_sees(setting)(poses)
    with print_settings():
        figure = sheet(WIDE, 66)
        cells = figure.add_gridspec(1, 2, width_ratios=[1.5, 1.0])
        _scene(figure, cells[0], setting)
        image: Any = figure.add_subplot(cells[1])
        _image(image, setting, poses, sees)
    view = setting.view
    distance = float(np.linalg.norm(view.T_world_camera[:3, 3] - setting.arm.motion(setting.start[None])[0][0]))
    side = float(np.linalg.norm(view.target.points[0] - view.target.points[1]))
    caption = (
        f"Left: the arm at the initial pose with the triangle of three discs (side {number(side)} mm) on its last "
        f"link, and the camera {number(distance / 1000)} m away. Right: its image of {view.camera.width} × "
        f"{view.camera.height} pixels with the triangle at the {plural(len(poses), 'pose')} of the plan by the "
        f"{PLANS[plan].label.replace(' (GA)', '')}; solid where all discs are seen at less than "
        f"{number(float(np.rad2deg(setting.incidence)), 2)}° from straight ahead, {int(sees.sum())} of "
        f"{len(poses)}, dotted elsewhere. Camera, lens, target and their places are our choices: the paper gives none."
    )
    return Illustration(settle(figure), "paper_vision", "Vision set-up (paper: Fig. 3)", caption)


def _scene(figure: Any, cell: Any, setting: Setting) -> None:
    view, start = setting.view, setting.start[None]
    nodes = setting.arm.nodes(start)[0]
    tool = setting.arm.tool(start)[0]
    corners = view.tool_points @ tool[:3, :3].T + tool[:3, 3]
    eye = view.T_world_camera[:3, 3]
    around = np.vstack([nodes, corners, eye[None], [[-500, 0, 0], [500, 0, 0]]])
    # from the camera's side, to which the target turns its face
    axes = space_axes(figure, cell, around, azimuth=28.0, elevation=18.0, zoom=1.3)
    draw_camera(axes, view.camera, view.T_world_camera, 0.6 * float(np.linalg.norm(tool[:3, 3] - eye)))
    draw_arm(axes, nodes)
    draw_face(axes, corners, BLUE)
    draw_points(axes, corners, marker="o", markersize=1.6, color=INK)
    above = np.array([0.0, 0.0, 120.0])
    draw_label(axes, corners.mean(axis=0) + above, "target")
    draw_label(axes, eye + above, "camera")
    axes.set_title("the scene", y=0.98)


def _image(axes: Any, setting: Setting, poses: Array, sees: NDArray[np.bool_]) -> None:
    camera, pixels = setting.view.camera, setting.view.pixels(poses)
    axes.add_patch(Rectangle((0, 0), camera.width, camera.height, fill=False, edgecolor=INK, linewidth=0.8))
    for corners, seen in zip(pixels, sees, strict=True):
        if np.isfinite(corners).all():
            axes.add_patch(
                Polygon(
                    corners,
                    closed=True,
                    facecolor=(*to_rgb(BLUE), 0.12) if seen else "none",
                    edgecolor=BLUE if seen else FAINT,
                    linewidth=0.7 if seen else 0.6,
                    linestyle="-" if seen else ":",
                )
            )
    margin = 0.04 * camera.width
    axes.set_xlim(-margin, camera.width + margin)
    axes.set_ylim(camera.height + margin, -margin)
    axes.set_aspect("equal")
    axes.set(xlabel="u / px", ylabel="v / px", title="what the camera sees")
    grid(axes, "both")
