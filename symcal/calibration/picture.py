"""Errors before and after, pose by pose, as a small drawing."""

from __future__ import annotations

import numpy as np

from symcal.calibration.evaluate import evaluate
from symcal.colors import BLUE, ORANGE
from symcal.data.dataset import Dataset, evenly
from symcal.errors import SymcalError
from symcal.model.model import State
from symcal.notebook import Dots, Panel, sketch

_MOST = 200  # poses


def errors_sketch(before: State, after: State, data: Dataset | None) -> str:
    """An SVG element: errors at the poses of data, by a logarithm; empty without data, or where nothing judges them."""
    if data is None or not len(data):
        return ""
    some = data.take(evenly(len(data), _MOST))
    try:
        found = evaluate(before, some), evaluate(after, some)
    except SymcalError:  # nothing to judge by: what was found stands in the table
        return ""
    order = evenly(len(data), _MOST) + 1
    before_at, after_at = (np.column_stack([order[errors.pose], errors.size]) for errors in found)
    dots = Dots(before_at, ORANGE, "ring", "before: nominal, frames fitted"), Dots(after_at, BLUE, "disc", "after")
    panel = Panel("training poses", "number of the pose", f"{found[1].title} {found[1].unit}", dots, log=True)
    return sketch(f"{found[1].title} before and after, at the poses that it was identified from", [panel])
