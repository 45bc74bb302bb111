"""Where the robot will be accurate: expected errors over the area, as two drawings that need no script."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from symcal.plots.cells import from_side, in_cells
from symcal.words import number

Array = NDArray[np.float64]

_CELLS = 28  # along the longer side
_COLORS = 64
_STEPS = 5  # of the scale's words


def area_map(found: dict[str, Any] | None) -> dict[str, Any] | None:
    """Cells of both views with their colours, the scale, and what it is said to be; None where nothing is foretold.

    Args:
        found: `area` of `symcal.page.scene.scene`.
    """
    if found is None:
        return None
    tool, errors = np.array(found["tool"], dtype=np.float64), np.array(found["error"])
    flats = {"from above": tool[:, :2], "from the side": from_side(tool, np.zeros(3))}
    cell = max(float(np.ptp(flat, axis=0).max()) for flat in flats.values()) / _CELLS
    panels = {name: in_cells(flat, errors, cell) for name, flat in flats.items()}
    values = np.concatenate([grid[np.isfinite(grid)] for grid, _, _ in panels.values()])
    low, high = float(values.min()), float(values.max())
    names = {"from above": ("x", "y"), "from the side": ("distance from the axis of the base", "z")}
    return {
        "views": [_view(name, panel, names[name], (low, high)) for name, panel in panels.items()],
        "scale": [[number(low + k * (high - low) / _STEPS, 2), _color(k / _STEPS)] for k in range(_STEPS + 1)],
        "rms": number(float(np.sqrt(np.mean(errors**2)))),
        "p95": number(float(np.percentile(errors, 95))),
        "count": len(errors),
        "where": "within the joint limits" if found["limits"] else "of the working area",
    }


def _view(
    name: str, panel: tuple[Array, Array, Array], axes: tuple[str, str], scale: tuple[float, float]
) -> dict[str, Any]:
    """Squares in mm, y downwards as drawings have it."""
    grid, x, y = panel
    side, span = float(x[1] - x[0]), max(scale[1] - scale[0], 1e-12)
    cells = [
        {"x": round(float(x[i])), "y": round(-float(y[k]) - side), "color": _color((grid[i, k] - scale[0]) / span)}
        for i, k in np.argwhere(np.isfinite(grid))
    ]
    box = [round(float(x[0])), round(-float(y[-1])), round(float(x[-1] - x[0])), round(float(y[-1] - y[0]))]
    return {"name": name, "axes": axes, "cells": cells, "side": round(side) + 1, "box": box}


def _color(share: float) -> str:
    return _colors()[round(float(share) * (_COLORS - 1))]


@cache
def _colors() -> tuple[str, ...]:
    return tuple(to_hex(color) for color in colormaps["cividis"](np.linspace(0, 1, _COLORS)))
