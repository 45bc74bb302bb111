"""What the page's script draws: poses, arms and marks as plain data, in mm and degrees."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import expected_position_rms
from symcal.page.arm import postures
from symcal.page.marks import Marks
from symcal.plots.style import BLUE, FAINT, GREEN, INK, ORANGE, VERMILION
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
Area = tuple[Array, Array]

COLORS = {"ink": INK, "faint": FAINT, "before": ORANGE, "after": BLUE, "train": GREEN, "test": VERMILION}
"""As in all figures; shapes tell the same, for those who do not see the colours."""

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
        "joints": _joints(robot),
        "through": list(arm.joints),
        "poses": {
            "label": list(found.poses.labels),
            "split": list(found.poses.split),
            "q": shown(robot, found.poses.q).round(3).tolist(),
            "nodes": np.rint(arm.nodes).astype(int).tolist(),
            "axes": _short(arm.axes),
            "pointers": _short(arm.pointers),
        },
        "marks": {
            "pose": [row.pose for row in rows],
            "part": [row.part for row in rows],
            "instrument": [row.instrument for row in rows],
            "point": [row.point for row in rows],
            "unit": [row.unit for row in rows],
            "names": [list(row.names) for row in rows],
            "at": [np.round(p, 1).tolist() for p in at],
            "own": [[_digits(row.before), _digits(row.after)] for row in rows],
            "vector": [
                [_digits(turn.T @ v) for v in (row.before, row.after)] if row.directed else None for row in rows
            ],
            "size": [_digits(np.array(row.sizes)) for row in rows],
            "turn": [None if row.turns is None else _digits(np.array(row.turns)) for row in rows],
            "held": [None if row.held_out is None else float(f"{row.held_out:.5g}") for row in rows],
        },
        "worst": found.worst,
        "area": _map(calibration, found, area, rng),
    }


def shown(robot: Robot, q: Array) -> Array:
    """Joint readings in degrees and mm."""
    return np.asarray(q * np.where([joint.revolute for joint in robot.joints], 180 / np.pi, 1.0))


def _joints(robot: Robot) -> list[dict[str, Any]]:
    """Names and kinds; limits in deg or mm, None where the file has none; by how much the coordinate moves."""
    lower, upper = shown(robot, robot.lower), shown(robot, robot.upper)
    return [
        {
            "name": joint.name,
            "kind": joint.kind,
            "unit": "deg" if joint.revolute else "mm",
            "limits": [float(lower[i]), float(upper[i])] if np.isfinite(upper[i] - lower[i]) else None,
            "sense": joint.sign * joint.ratio,
        }
        for i, joint in enumerate(robot.joints)
    ]


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
    return {"tool": np.rint(tool).astype(int).tolist(), "error": _digits(errors), "limits": area is None}


def _short(directions: Array) -> list[Any]:
    """Directions in hundredths."""
    found: list[Any] = np.rint(100 * directions).astype(int).tolist()
    return found


def _digits(values: Array) -> list[float]:
    return [float(f"{value:.5g}") for value in np.ravel(values)]
