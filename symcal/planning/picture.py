"""How the poses of a plan use the joints, as a small drawing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.colors import BLUE
from symcal.notebook import Panel, Path, sketch
from symcal.planning.area import WorkingArea

Array = NDArray[np.float64]

_PARTS = 25
_TALL = 0.75  # of a row


def plan_sketch(poses: Array, area: WorkingArea) -> str:
    """An SVG element: for every joint how many poses have it in each part of its range; empty without poses."""
    if not len(poses):
        return ""
    part = np.clip((area.unit(poses) * _PARTS).astype(int), 0, _PARTS - 1)
    counts = np.stack([np.bincount(column, minlength=_PARTS) for column in part.T])
    bars = []
    for joint, row in enumerate(counts):
        for k in np.flatnonzero(row):
            x = 100 * (k + 0.5) / _PARTS
            bars.append(Path(np.array([[x, joint], [x, joint - _TALL * row[k] / counts.max()]]), BLUE, 6.0))
    names = tuple(f"joint {i + 1}" for i in range(area.dof))
    panel = Panel(f"where {len(poses)} poses have the joints", "% of the range", "", tuple(bars), rows=names)
    return sketch("how many poses have each joint where in its range", [panel])
