"""What the page's script draws: poses, arms and marks as plain data, in mm and degrees."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import expected_position_rms
from symcal.page.arm import postures
from symcal.page.body import COLORS, body, five_digits, joints
from symcal.page.marks import Mark, Marks

Array = NDArray[np.float64]
Area = tuple[Array, Array]

SAMPLES = 1500
"""Random postures of the map of predicted errors."""


def scene(calibration: Calibration, found: Marks, area: Area | None, rng: np.random.Generator) -> dict[str, Any]:
    """Everything about poses and marks that the page shows in space.

    Args:
        area: lower and upper joint readings of the working area; the joint limits when None.
    """
    model, setup, x, robot = calibration.model, calibration.setup, calibration.after.x, calibration.robot
    arm = postures(model, setup, x, found.poses)
    turn = model.moved(setup, x).base[:3, :3]
    rows = found.rows
    at = [_place(arm.measured, arm.nodes, row.pose, row.instrument, row.feature) for row in rows]
    return {
        "colors": COLORS,
        "robot": robot.name,
        "joints": joints(robot),
        "through": list(arm.joints),
        "poses": {
            "label": list(found.poses.labels),
            "split": list(found.poses.split),
            **body(robot, arm, found.poses.q),
        },
        "marks": {
            "pose": [row.pose for row in rows],
            "part": [row.part for row in rows],
            "instrument": [row.instrument for row in rows],
            "point": [row.point for row in rows],
            "unit": [row.unit for row in rows],
            "names": [list(row.names) for row in rows],
            "at": [np.round(p, 1).tolist() for p in at],
            "own": [[five_digits(row.before), five_digits(row.after)] for row in rows],
            "vector": [
                [five_digits(turn.T @ v) for v in (row.before, row.after)] if row.directed else None for row in rows
            ],
            "size": [five_digits(np.array(row.sizes)) for row in rows],
            "turn": [None if row.turns is None else five_digits(np.array(row.turns)) for row in rows],
            "held": [None if row.held_out is None else float(f"{row.held_out:.5g}") for row in rows],
            "largest": [_of_its_points(row) for row in rows],
        },
        "worst": found.worst,
        "area": _map(calibration, found, area, rng),
    }


def _of_its_points(row: Mark) -> float | None:
    """The largest error of a row that stands for many points."""
    size = row.sizes[1] if row.held_out is None else row.held_out
    return float(f"{row.largest:.5g}") if row.largest is not None and row.largest > size * (1 + 1e-9) else None


def _place(measured: dict[str, Array], nodes: Array, pose: int, instrument: str, feature: int) -> Array:
    """Where a mark is: its feature of the arm; the tool, for errors that no instrument has read."""
    if instrument not in measured:
        return np.asarray(nodes[pose, -1])
    points = measured[instrument][pose]
    return np.asarray(points[min(feature, len(points) - 1)])


def _map(calibration: Calibration, found: Marks, area: Area | None, rng: np.random.Generator) -> dict[str, Any] | None:
    """What the uncertainty of the parameters lets expect at random postures: where the tool is, and rms error, mm."""
    model, robot = calibration.model, calibration.robot
    if not any(o.instrument.gives_point for o in model.task.observations):
        return None
    lower, upper = robot.ranges if area is None else area
    q = rng.uniform(lower, upper, (SAMPLES, robot.dof))
    free = type(found.poses)(found.poses.of, q, np.full((SAMPLES, found.poses.z.shape[1]), np.nan), (), ())
    tool = postures(model, calibration.setup, calibration.after.x, free).nodes[:, -1]
    errors = expected_position_rms(model, calibration.after, q)
    return {"tool": np.rint(tool).astype(int).tolist(), "error": five_digits(errors), "limits": area is None}
