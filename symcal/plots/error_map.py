"""Where the robot will be accurate: the predicted error over the task region."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from symcal.planning.plan_study import PlanStudy
from symcal.plots.cells import draw_cells, from_side, in_cells
from symcal.plots.style import INK, WIDE, Illustration, print_settings, settle, sheet
from symcal.words import number

Array = NDArray[np.float64]

_CELLS = 40  # along the longer side of the region
_DRAWN, _MARGIN = 116.0, 20.0  # width of both views together, height of labels and title, mm


def error_map(found: PlanStudy) -> Illustration:
    """Largest predicted rms error of all sampled poses with the tool in a cell, from above and from the side."""
    field, plan = found.field, found.planned.plan
    base = found.problem.info.setup.base[:3, 3]
    tool = found.problem.arm.motion(plan.poses)[0]
    views = (
        ("from above", "x / mm", "y / mm", field.tool[:, :2], tool[:, :2]),
        (
            "from the side",
            "distance from\nthe z axis / mm",
            "z / mm",
            from_side(field.tool, base),
            from_side(tool, base),
        ),
    )
    cell = max(float(np.ptp(flat, axis=0).max()) for _, _, _, flat, _ in views) / _CELLS
    panels = [in_cells(flat, field.errors, cell) for _, _, _, flat, _ in views]
    values = np.concatenate([grid[np.isfinite(grid)] for grid, _, _ in panels])
    scale = Normalize(float(values.min()), float(values.max()))
    with print_settings():
        width, height = [float(np.ptp(x)) for _, x, _ in panels], max(float(np.ptp(y)) for _, _, y in panels)
        figure = sheet(WIDE, float(np.clip(_MARGIN + height * _DRAWN / sum(width), 52.0, 120.0)))
        rows: Any = figure.subplots(1, 2, width_ratios=width)
        for axes, (title, right, up, _, marks), cells in zip(rows, views, panels, strict=True):
            draw_cells(axes, cells, scale)
            axes.plot(
                *marks.T,
                linestyle="none",
                marker="o",
                markersize=2.6,
                color=INK,
                markerfacecolor="white",
                clip_on=False,
                zorder=3,
            )
            axes.set(xlabel=right, ylabel=up)
            axes.set_title(title)
        bar = figure.colorbar(ScalarMappable(scale, "cividis"), ax=list(rows), pad=0.015, aspect=24)
        bar.set_label("predicted rms position error / mm")
        bar.outline.set_visible(False)
    return Illustration(settle(figure), "error_map", "Predicted error over the region", _caption(found))


def _caption(found: PlanStudy) -> str:
    foretold, errors = found.planned.plan.prediction, found.field.uniform
    return (
        "Predicted rms position error of the tool after an identification from these poses: "
        f"the largest of all of {len(found.field.errors)} sampled poses whose tool is in a cell. Rms over the "
        f"region {number(foretold.mean_pose_rms_mm)} mm; largest, searched between the samples too, "
        f"{number(foretold.worst_pose_rms_mm)} mm; 95 % of the poses are below "
        f"{number(float(np.percentile(errors, 95)))} mm. Circles: tool positions of the plan."
    )
