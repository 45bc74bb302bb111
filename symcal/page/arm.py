"""Where the arm is at many postures: corners of its body, axes of its joints, and what of it was measured.

All of it comes from the one kinematic expression at the estimate, in the base frame, mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.kernels import batch_function
from symcal.kinematics import chain, function, pose_of
from symcal.kinematics.body import body
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.model.observation import Observation
from symcal.model.symbols import Symbols

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Postures:
    """An arm at N postures, in its base frame, mm.

    nodes: corners of its body from the base to the tool, shape (N, m, 3). joints: the node that each joint's axis goes
    through. axes: direction of each joint's axis, shape (N, dof, 3). pointers: what turns with the joint, at a right
    angle to its axis, shape (N, dof, 3). measured: by observation where its features are (its own place, where the
    instrument rides on the arm), shape (N, k, 3).
    """

    nodes: Array
    joints: tuple[int, ...]
    axes: Array
    pointers: Array
    measured: dict[str, Array]


def postures(model: Model, setup: Setup, x: Array, data: Dataset) -> Postures:
    """The arm of a model with errors ``x`` at the poses of data, whose joint readings and conditions count."""
    robot, task = model.robot, model.task
    own = chain(robot, model.parameters, conditions=bool(robot.conditions))
    symbols = Symbols.of(own, task.everything)
    state = {"q": own.q, "x": own.x, "setup": symbols.setup}
    ends = {o.name: _measured(symbols, o) for o in task.observations}
    outputs = {
        "frames": ca.horzcat(pose_of(own.stations["base"]), *own.links, pose_of(own.stations["flange"]), own.tool),
        **{f"m{i}": ca.horzcat(*points) for i, points in enumerate(ends.values())},
    }
    whole = batch_function(function("postures", state, outputs), evaluations=0)
    frames, *points = whole(data.q, x, setup.under(data.conditions))
    frames = frames.reshape(len(data), 4, -1, 4).transpose(0, 2, 1, 3)  # (N, dof + 3, 4, 4) in world
    R, o = frames[:, :1, :3, :3], frames[:, :1, :3, 3]
    frames = np.asarray(np.linalg.solve(frames[:, :1], frames), dtype=np.float64)
    measured = {
        name: (p.reshape(len(data), 3, -1).transpose(0, 2, 1) - o) @ R[:, 0]
        for name, p in zip(ends, points, strict=True)
    }
    nodes, at = body(frames, robot.convention == "standard")
    n = robot.dof
    before, after = frames[:, :n, :3, :], frames[:, 1 : n + 1, :3, :]
    turning = before if robot.convention == "standard" else after
    axes, pointers = turning[..., 2], after[..., 0]
    pointers = pointers - np.sum(pointers * axes, axis=-1, keepdims=True) * axes
    pointers = pointers / np.linalg.norm(pointers, axis=-1, keepdims=True)
    through = tuple(at[i if robot.convention == "standard" else i + 1] for i in range(n))
    return Postures(nodes, through, axes, pointers, measured)


def _measured(symbols: Symbols, o: Observation) -> list[ca.SX]:
    """Where in world the features of an observation are that move with the arm; one point for boards of many."""
    if o.target.at.moves:
        read = symbols.station(o.target.name, o.target.at)
        if o.staged or o.instrument.reads != "points":
            return [read.origin]
        return [symbols.point(o.target, feature, read)[0] for feature in o.features] or [read.origin]
    return [symbols.station(o.place, o.at).origin] if o.at.moves else [symbols.chain.tool[:3, 3]]
