"""An arm as a small drawing: from the side and from above, with all joints in the middle of their limits."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.colors import BLUE, FAINT, INK, VERMILION
from symcal.kinematics.body import body
from symcal.kinematics.chain import chain, frame_vector
from symcal.kinematics.screws import pose_of
from symcal.notebook import Dots, Panel, Path, sketch
from symcal.parameters import ParameterSet
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

_Z = 2


def frames_at(robot: Robot, q: Array) -> Array:
    """Base, every link's frame, flange and tool in world at joint readings (dof,), shape (dof + 3, 4, 4), mm."""
    model = chain(robot, ParameterSet(()))
    every = ca.horzcat(pose_of(model.stations["base"]), *model.links, model.flange, model.tool)
    found = ca.Function("frames", [model.q, model.x, model.frames], [every])
    given = q, np.zeros(0), frame_vector(robot.base, robot.tool)
    return np.array(found(*given)).reshape(4, -1, 4).transpose(1, 0, 2)


def robot_sketch(robot: Robot) -> str:
    """An SVG element, drawn by the kinematics that identifications use; empty for a robot without joints."""
    if not robot.dof:
        return ""
    lower, upper = robot.ranges
    frames = frames_at(robot, (lower + upper) / 2)
    frames = np.linalg.solve(frames[0], frames)  # as the base sees it
    (nodes,), at = body(frames[None], robot.convention == "standard")
    first = 0 if robot.convention == "standard" else 1  # a joint's axis goes through the frame before it, or its own
    joints = nodes[at[first : first + robot.dof]]
    wide = int(np.ptp(nodes[:, 1]) > np.ptp(nodes[:, 0]))  # the side from which more of it is seen
    turns = np.array([joint.revolute for joint in robot.joints])
    panels = [
        Panel(
            title,
            f"{'xyz'[across]} mm",
            f"{'xyz'[up]} mm",
            (
                Path(nodes[:, [across, up]], FAINT, 5.0),
                Dots(joints[turns][:, [across, up]], INK, "disc", "revolute joint"),
                Dots(joints[~turns][:, [across, up]], BLUE, "square", "" if turns.all() else "prismatic joint"),
                Dots(nodes[-1:, [across, up]], VERMILION, "ring", "tool"),
            ),
            equal=True,
            span=float(np.ptp(nodes, axis=0).max()),
        )
        for title, across, up in (("from the side", wide, _Z), ("from above", 0, 1))
    ]
    return sketch(f"{robot.name} with its joints in the middle of their limits, from the side and from above", panels)
