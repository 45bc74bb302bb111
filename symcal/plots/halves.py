"""Where two halves of the training poses predict the tool differently, and by how many of their uncertainties."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from symcal.calibration.apart import WITHIN, Apart
from symcal.plots.cells import draw_cells, from_side, in_cells
from symcal.plots.style import INK, WIDE, Illustration, print_settings, settle, sheet
from symcal.words import number, percent

Array = NDArray[np.float64]

_CELLS = 22  # along the longer side of what the tool reaches
_BEYOND = 2.0  # times what is to be expected, from which a cell is marked; colours reach it, so that calm looks calm
_DRAWN, _HEAD = 118.0, 18.0  # width of both views together, height of labels and titles, mm
_NO_SIZE = 1e-9


def halves_map(found: Apart, what: str, who: str) -> Illustration:
    """Rms of the difference of two calibrations in every cell that the tool is in, and that over what is to be expected
    of it, from above and from the side of the base.

    Args:
        what: which two, for the caption: `two halves of the training poses, ...`. who: their short name.
    """
    views = (
        ("from above", "x / mm", "y / mm", found.at[:, :2]),
        ("from the side", "distance from\nthe z axis / mm", "z / mm", from_side(found.at, np.zeros(3))),
    )
    cell = max(float(np.ptp(flat, axis=0).max()) for _, _, _, flat in views) / _CELLS or _NO_SIZE
    widths = [float(np.ptp(flat[:, 0])) + cell for _, _, _, flat in views]
    height = max(float(np.ptp(flat[:, 1])) + cell for _, _, _, flat in views)
    rows = ("difference / mm", "difference over\nwhat is expected")
    with print_settings():
        figure = sheet(WIDE, 2 * float(np.clip(_HEAD + height * _DRAWN / sum(widths), 36.0, 66.0)))
        panels: Any = figure.subplots(2, 2, width_ratios=[max(width, 0.25 * max(widths)) for width in widths])
        for row, label in enumerate(rows):
            grids = [_rms_of(found, flat, cell, over=bool(row)) for _, _, _, flat in views]
            values = np.concatenate([grid[np.isfinite(grid)] for grid, _, _ in grids])
            scale = Normalize(0.0, max(float(values.max()), _BEYOND if row else 0.0) or 1.0)
            for column, ((title, right, up, _), cells) in enumerate(zip(views, grids, strict=True)):
                axes = panels[row, column]
                draw_cells(axes, cells, scale)
                if row:
                    _mark(axes, *cells)
                axes.set(xlabel=right if row else "", ylabel=up)
                axes.set_title(title if not row else "")
            bar = figure.colorbar(ScalarMappable(scale, "cividis"), ax=list(panels[row]), pad=0.015, aspect=18)
            bar.set_label(label)
            bar.outline.set_visible(False)
    return Illustration(settle(figure), "halves", f"{who} compared", _caption(found, what))


def _rms_of(found: Apart, flat: Array, cell: float, *, over: bool) -> tuple[Array, Array, Array]:
    """Rms of the difference in every cell, over that of what is expected there if asked for."""
    squares, x, y = in_cells(flat, found.apart**2, cell, "mean")
    if over:
        squares = squares / np.maximum(in_cells(flat, found.sigma**2, cell, "mean")[0], _NO_SIZE**2)
    return np.sqrt(squares), x, y


def _mark(axes: Any, grid: Array, x: Array, y: Array) -> None:
    """Crosses where more than twice what is expected was found, so that a grey copy says it."""
    own = np.argwhere(np.nan_to_num(grid) > _BEYOND)
    at = np.column_stack([(x[own[:, 0]] + x[own[:, 0] + 1]) / 2, (y[own[:, 1]] + y[own[:, 1] + 1]) / 2])
    axes.plot(
        *at.T, linestyle="none", marker="x", markersize=2.6, markeredgewidth=1.4, color="white", zorder=3, alpha=0.9
    )
    axes.plot(*at.T, linestyle="none", marker="x", markersize=2.2, markeredgewidth=0.6, color=INK, zorder=4)


def _caption(found: Apart, what: str) -> str:
    own = found.compared
    return (
        f"Difference of what {what} predict of the tool's position in base, of {len(found.apart)} random postures: rms "
        f"in every cell (above), and that over what their stated uncertainties let expect there (below; 1 as stated, "
        f"crosses where it is more than 2). In all {number(own.difference)} mm rms where {number(own.predicted)} mm is "
        f"to be expected; at {percent(found.within)} of the postures the difference is within the bounds that "
        f"{percent(WITHIN)} should be in."
    )
