"""The table of marks: what was read at which joint readings, and how far the robot was off it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from symcal.page.body import shown
from symcal.page.marks import Marks
from symcal.robot.robot import Robot
from symcal.words import fixed, number

_PARTS = {"train": "training", "test": "held-out"}


def points_table(found: Marks, robot: Robot, *, worst: int | None) -> dict[str, Any]:
    """Head and rows, every cell with its text and what it is sorted by; and the units, that of the worst row first."""
    rows = found.rows
    several, named = len({row.instrument for row in rows}) > 1, any(row.point for row in rows)
    first = [] if worst is None else [rows[worst].unit]
    units = list(dict.fromkeys([*first, *(row.unit for row in rows)]))
    unit = f" / {units[0]}" if len(units) == 1 else ""
    held, turned = any(row.held_out is not None for row in rows), any(row.turns for row in rows)
    q = shown(robot, found.poses.q)
    head = ["pose", "split"]
    head += ["instrument"] * several + ["point"] * named
    head += [f"before{unit}", f"after{unit}"] + [f"held out{unit}"] * held
    head += ["turned by / deg"] * turned
    head += joint_heads(robot)
    places = decimals(row.sizes[1] for row in rows)
    body = []
    for i, row in enumerate(rows):
        cells = [text_cell(found.poses.labels[row.pose]), text_cell(_PARTS.get(row.part, row.part))]
        cells += [text_cell(row.instrument)] * several + [text_cell(row.point)] * named
        suffix = "" if len(units) == 1 else f" {row.unit}"
        cells += [number_cell(size, places, suffix) for size in row.sizes]
        cells += [number_cell(row.held_out, places, suffix)] * held
        cells += [number_cell(None if row.turns is None else row.turns[1], 3)] * turned
        cells += [number_cell(round(float(value), 2), 2) for value in q[row.pose]]
        body.append({"number": i, "cells": cells, "worst": i == worst})
    return {"head": head, "rows": body, "of": found.of, "units": units}


def joint_heads(robot: Robot) -> list[str]:
    """Names of the joints with the units of their readings."""
    return [f"{joint.name} / {'deg' if joint.revolute else 'mm'}" for joint in robot.joints]


def decimals(sizes: Iterable[float]) -> int:
    """So many that the middle one of some errors has three digits."""
    known = sorted(size for size in sizes if size > 0)
    return min(max(2 - math.floor(math.log10(known[len(known) // 2])), 0), 6) if known else 3


def text_cell(words: str) -> dict[str, Any]:
    """A cell with words."""
    return {"text": words, "value": words, "number": False}


def number_cell(value: float | None, places: int, suffix: str = "") -> dict[str, Any]:
    """A cell with a number of so many decimals, sorted by all of them."""
    if value is None or not math.isfinite(value):
        return {"text": "–", "value": "", "number": True}
    words = fixed(value, places) if value >= 10.0**-places or value <= 0 else number(value, 2)
    return {"text": f"{words}{suffix}", "value": f"{value:.6g}", "number": True}
