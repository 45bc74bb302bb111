"""Calibrated robots for the exported C, and kinematics written here from their tables with NumPy alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from decisions import ACCEPTED

from symcal.robot.files import load_robot
from symcal.robot.robot import Record, Robot

ROBOTS = Path(__file__).resolve().parents[2] / "configs" / "robots"

# [Ding2017] Table I: theta, d, a, alpha, beta; q marks the joint variable, X a motion that the link does not have.
Q, X = "q", 0.0
TABLE_I = (
    (Q, X, X, 0.0, 0.0),
    (X, Q, X, -np.pi / 2, X),
    (X, Q, X, 0.0, 0.0),
    (Q, 300.0, 0.0, -np.pi / 2, X),
    (Q, 25.0, 0.0, 0.0, X),
)
# [Ding2017] Table III, in the same columns.
TABLE_III = (
    (0.002638, X, X, 0.003693, 0.00123),
    (X, 0.0184, X, -0.005797, X),
    (X, 0.0240, X, 0.005499, 0.006221),
    (0.001455, -0.0417, -0.0760, 0.001450, X),
    (-0.001361, 0.0530, 0.0240, X, X),
)
COLUMNS = ("theta", "d", "a", "alpha", "beta")


def calibrated(robot: Robot, errors: Mapping[str, float], tool_shift: float = 0.0) -> Robot:
    """The robot as an identification leaves it; ``tool_shift`` moves its tool too, mm along x."""
    n = len(errors)
    record = Record(dict(errors), dict.fromkeys(errors, 1e-3), 1e-6 * np.eye(n), robot.base, robot.tool, ACCEPTED)
    tool = robot.tool.copy()
    tool[0, 3] += tool_shift
    return replace(robot.corrected(errors), tool=tool, record=record)


def handling() -> Robot:
    """The paper's robot with the errors of its Table III."""
    errors = {
        f"{kind}_{i}": value
        for i, row in enumerate(TABLE_III, start=1)
        for kind, value in zip(COLUMNS, row, strict=True)
        if value != X
    }
    return calibrated(load_robot(ROBOTS / "handling_robot.yaml"), errors)


def arm(name: str, seed: int = 7) -> Robot:
    """A shipped robot with errors of about a milliradian and a third of a millimetre, and a shifted tool."""
    robot, rng = load_robot(ROBOTS / f"{name}.yaml"), np.random.default_rng(seed)
    errors = {p: rng.normal() * (1e-3 if p.startswith(("theta", "alpha", "beta")) else 0.3) for p in robot.parameters}
    return calibrated(robot, errors, 0.5)


def table_pose(q: np.ndarray, errors: bool) -> np.ndarray:
    """T_base_tool of the handling robot from Tables I and III, shape (N, 4, 4)."""
    walk = Walk(len(q))
    for i in range(5):
        for column, (nominal, error) in enumerate(zip(TABLE_I[i], TABLE_III[i], strict=True)):
            value = (q[:, i] if nominal == Q else nominal) + (error if errors else 0.0)
            walk.move(COLUMNS[column], value)
    return walk.pose()


def robot_pose(robot: Robot, q: np.ndarray) -> np.ndarray:
    """T_base_tool of any robot from its table, shape (N, 4, 4)."""
    order = COLUMNS if robot.convention == "standard" else ("alpha", "a", "beta", "theta", "d")
    walk = Walk(len(q))
    for i, link in enumerate(robot.links):
        joint = link.joint
        for kind in order:
            value = np.full(len(q), link.parameters.get(kind, 0.0))
            if kind == ("theta" if joint.kind == "revolute" else "d"):
                value = value + joint.sign * joint.ratio * q[:, i] + joint.offset
            walk.move(kind, value)
    return walk.pose() @ robot.tool


class Walk:
    """Frames that elementary motions carry along, one per reading."""

    def __init__(self, count: int) -> None:
        self.rotation, self.origin = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))

    def move(self, kind: str, value: np.ndarray | float) -> None:
        axis = {"theta": 2, "d": 2, "a": 0, "alpha": 0, "beta": 1}[kind]
        value = np.broadcast_to(np.asarray(value, dtype=float), len(self.origin))[:, None]
        if kind in ("a", "d"):
            self.origin = self.origin + value * self.rotation[:, :, axis]
            return
        first, second = ((1, 2), (2, 0), (0, 1))[axis]
        u, v = self.rotation[:, :, first].copy(), self.rotation[:, :, second].copy()
        self.rotation[:, :, first] = np.cos(value) * u + np.sin(value) * v
        self.rotation[:, :, second] = np.cos(value) * v - np.sin(value) * u

    def pose(self) -> np.ndarray:
        pose = np.tile(np.eye(4), (len(self.origin), 1, 1))
        pose[:, :3, :3], pose[:, :3, 3] = self.rotation, self.origin
        return pose
