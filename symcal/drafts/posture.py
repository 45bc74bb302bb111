"""A posture from which an arm can be measured, where nobody has said one: a guess for first files.

Of many postures the one is taken whose tool is in front of the arm at about half of its reach, above the table, and
points where it shall, with joints in the middle of their ranges and the elbow up; weights and places are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.model.model import build_model
from symcal.model.task import Task
from symcal.planning.skeleton import Skeleton, skeleton
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
Facing = Literal["down", "outward"]

_DRAWN, _KEPT, _ROUNDS = 3000, 30, 12  # postures at first and in each round, and those that a round starts from
_SPREAD = 0.25  # of a joint's range: of the first round's steps, which shrink to a thousandth of that
_WIDEST = np.pi  # rad: a joint that turns further, or without end, is used from minus to plus half a turn
_FAR = 0.55  # of the reach, horizontally
_HEIGHT = 0.25  # of the reach, above the base, where no height is asked for
_CLEAR = 100.0  # mm: of every link that can be raised, above the base
_UPRIGHT = 0.5  # least height of the tool's z axis, of 1, where it always points up


@dataclass(frozen=True, slots=True)
class Posture:
    """q: joint readings, shape (dof,), rad and mm. lower, upper: readings that are in question at all, shape (dof,).

    reach: how far the tool gets from the base's axis, mm. first_link: of the links that a table can be in the way of;
    None if some are always below its level. outward: out of the flange, along the tool's z axis: 1, or -1 where that
    points up whatever the arm does, as in some descriptions of a SCARA. missed: angle between this and what it was
    meant to point at, rad.
    """

    arm: Skeleton
    q: Array
    lower: Array
    upper: Array
    reach: float
    first_link: int | None
    outward: float
    missed: float

    def tool(self, q: Array | None = None) -> Array:
        """T_base_tool, shape (4, 4), mm; at ``q`` if it is given."""
        return np.asarray(self.arm.tool((self.q if q is None else q)[None])[0])


def posture(robot: Robot, facing: Facing, height: float | None = None) -> Posture:
    """A posture whose tool points down, or away from the arm and level.

    Args:
        height: of the tool above the base, mm, as near as the arm gets with ease.
    """
    model = build_model(robot, Task.of("position"))
    arm = skeleton(model.measurement.chain, model.setup)
    lower, upper = _ranges(robot)
    rng = np.random.default_rng(0)
    q = rng.uniform(lower, upper, (_DRAWN, robot.dof))
    drawn = arm.tool(q)
    reach = float(np.quantile(np.linalg.norm(drawn[:, :2, 3], axis=1), 0.99))
    outward = -1.0 if np.all(drawn[:, 2, 2] > _UPRIGHT) else 1.0
    first, goal = _first_link(arm, q), _HEIGHT * reach if height is None else height
    for spread in _SPREAD * np.geomspace(1.0, 1e-3, _ROUNDS):
        turned = _turned(arm.tool(q), facing, outward)
        best = q[np.argsort(_discomfort(arm, q, lower, upper, turned, reach, goal, first), kind="stable")[:_KEPT]]
        steps = rng.normal(size=(_DRAWN // _KEPT, *best.shape)) * spread * (upper - lower)
        q = np.vstack([best, np.clip(best + steps, lower, upper).reshape(-1, robot.dof)])
    rough = np.where([joint.revolute for joint in robot.joints], np.deg2rad(5.0), 10.0)
    found = np.clip(np.round(best[0] / rough) * rough, lower, upper)
    missed = float(_turned(arm.tool(found[None]), facing, outward)[0])
    return Posture(arm, found, lower, upper, reach, first, outward, missed)


def _ranges(robot: Robot) -> tuple[Array, Array]:
    lower, upper = robot.ranges
    turns = np.array([joint.revolute for joint in robot.joints])
    around = turns & (lower < -_WIDEST) & (upper > _WIDEST)
    return np.where(around, -_WIDEST, lower), np.where(around, _WIDEST, upper)


def _first_link(arm: Skeleton, q: Array) -> int | None:
    """The first link that, with all behind it, is above the table in a good share of postures."""
    heights = arm.nodes(q)[:, :, 2]
    for link in dict.fromkeys(arm.links):
        if np.mean(heights[:, arm.links.index(link) :].min(axis=1) > _CLEAR) > 0.1:
            return link
    return None


def _turned(tool: Array, facing: Facing, outward: float) -> Array:
    """Angle between where tools (N, 4, 4) point and where they shall, shape (N,), rad."""
    x, y = tool[:, :2, 3].T
    away = np.stack([x, y, np.zeros_like(x)], axis=1) / np.maximum(np.hypot(x, y), 1.0)[:, None]
    wanted = np.array([0.0, 0.0, -1.0]) if facing == "down" else away
    return np.asarray(np.arccos(np.clip(outward * (tool[:, :3, 2] * wanted).sum(axis=1), -1.0, 1.0)))


def _discomfort(
    arm: Skeleton, q: Array, lower: Array, upper: Array, turned: Array, reach: float, goal: float, first: int | None
) -> Array:
    """How far postures (N, dof) are from what is wanted, shape (N,): 1 for what counts as much in each respect.

    Args:
        turned: see `_turned`.
    """
    nodes = arm.nodes(q)
    x, y, z = nodes[:, -1].T
    far = np.hypot(x, y)
    middle = (q - (lower + upper) / 2) / ((upper - lower) / 2)
    above = nodes[:, 0 if first is None else arm.links.index(first) :, 2]
    terms = [
        turned / 0.1,
        (far / reach - _FAR) / 0.1,
        (z - goal) / reach / 0.15,
        np.minimum(above.min(axis=1) - _CLEAR, 0.0) / 50.0,
        (1.0 - _mean_height(nodes) / reach) / 0.2,
        np.linalg.norm(middle, axis=1) / 0.5,
        np.maximum(np.abs(middle) - 0.8, 0.0).sum(axis=1) / 0.1,
        np.deg2rad(middle[:, 0] * 180.0),
    ]
    return np.asarray(sum(term**2 for term in terms))


def _mean_height(nodes: Array) -> Array:
    """Of the arm's polyline, shape (N,): with the elbow up it is larger."""
    lengths, heights = np.linalg.norm(np.diff(nodes, axis=1), axis=2), (nodes[:, 1:, 2] + nodes[:, :-1, 2]) / 2
    return np.asarray((lengths * heights).sum(axis=1) / np.maximum(lengths.sum(axis=1), 1.0))
