"""The arm as plain data that the page's script draws, in mm and degrees."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.page.arm import Postures
from symcal.plots.style import BLUE, FAINT, GREEN, INK, ORANGE, VERMILION
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

COLORS = {"ink": INK, "faint": FAINT, "before": ORANGE, "after": BLUE, "train": GREEN, "test": VERMILION}
"""As in all figures; shapes tell the same, for those who do not see the colours."""


def body(robot: Robot, arm: Postures, q: Array) -> dict[str, Any]:
    """An arm at N postures (N, dof): readings, corners, axes and what turns with the joints."""
    return {
        "q": shown(robot, q).round(3).tolist(),
        "nodes": np.rint(arm.nodes).astype(int).tolist(),
        "axes": in_hundredths(arm.axes),
        "pointers": in_hundredths(arm.pointers),
    }


def joints(robot: Robot) -> list[dict[str, Any]]:
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


def shown(robot: Robot, q: Array) -> Array:
    """Joint readings in degrees and mm."""
    return np.asarray(q * np.where([joint.revolute for joint in robot.joints], 180 / np.pi, 1.0))


def in_hundredths(directions: Array) -> list[Any]:
    """Directions as whole numbers."""
    found: list[Any] = np.rint(100 * directions).astype(int).tolist()
    return found


def five_digits(values: Array) -> list[float]:
    """Numbers with as many digits as anyone reads."""
    return [float(f"{value:.5g}") for value in np.ravel(values)]
