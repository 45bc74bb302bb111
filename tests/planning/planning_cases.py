"""The two robots on which planning is tried: the handling robot seen by positions, a Franka FR3 seen by poses."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np

from symcal import kinematics
from symcal.model.measurement import Setup
from symcal.model.observe import observe
from symcal.model.parameter_set import parameter_set
from symcal.model.task import Task
from symcal.planning.area import working_area
from symcal.planning.information import PoseInformation, pose_information
from symcal.robot.files import load_robot
from symcal.robot.robot import Joint, Link, Robot

SIGMA = 0.1 / math.sqrt(3)
"""Standard deviation of noise uniform on [-0.1, 0.1] mm."""

_HANDLING = Path(__file__).resolve().parents[2] / "configs" / "robots" / "handling_robot.yaml"


@cache
def handling() -> PoseInformation:
    """Handling robot, position of the last origin, base and tool known, over its front half."""
    robot = load_robot(_HANDLING)
    measurement = observe(kinematics.chain(robot, parameter_set(robot)), *Task.of("position").observations)
    setup = Setup(robot.base, robot.tool, np.zeros((1, 3)))
    area = working_area(robot, {"waist": (-math.pi / 2, math.pi / 2)})
    return pose_information(measurement, setup, {"position": SIGMA}, area=area)


@cache
def fr3() -> PoseInformation:
    """Franka FR3 (Craig's convention, the maker's data sheet), camera pose at 1 mm and 5 mrad, base and tool free."""
    table = [(0, 0, 333), (-90, 0, 0), (90, 0, 316), (90, 82.5, 0), (-90, -82.5, 384), (90, 0, 0), (90, 88, 0)]
    limits = [
        (-2.7437, 2.7437),
        (-1.7837, 1.7837),
        (-2.9007, 2.9007),
        (-3.0421, -0.1518),
        (-2.8065, 2.8065),
        (0.5445, 4.5169),
        (-3.0159, 3.0159),
    ]
    links = tuple(
        Link(
            Joint("revolute", f"joint_{i}", *limit),
            {"theta": 0.0, "alpha": math.radians(alpha), "a": float(a), "d": float(d)},
        )
        for i, ((alpha, a, d), limit) in enumerate(zip(table, limits, strict=True), start=1)
    )
    tool = np.array([[0, -1, 0, 94.5], [1, 0, 0, -9], [0, 0, 1, 147.55], [0, 0, 0, 1]], dtype=float)
    robot = Robot("fr3", "craig", links, tool=tool)
    measurement = observe(
        kinematics.chain(robot, parameter_set(robot, base=True, tool="frame")), *Task.of("pose").observations
    )
    setup = Setup(robot.base, robot.tool)
    return pose_information(measurement, setup, {"position": 1.0, "orientation": 0.005})
