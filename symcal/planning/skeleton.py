"""Where the arm is at many poses: its tool, and the polyline through its link frames that stands for its body."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.kernels import BatchFunction, batch_function
from symcal.kinematics import Chain
from symcal.model.measurement import Setup

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Skeleton:
    """The arm at given parameters as functions of its joint readings; made by `skeleton`.

    links: number of the link (from 1; dof + 1 is the tool) that each segment of the polyline belongs to.
    """

    links: tuple[int, ...]
    _tool: BatchFunction
    _nodes: BatchFunction
    _motion: BatchFunction

    def tool(self, poses: Array) -> Array:
        """T_world_tool, shape (N, 4, 4), mm, of poses (N, dof)."""
        return self._tool(poses)[0]

    def nodes(self, poses: Array) -> Array:
        """Corners of the polyline from the base to the tool in world, shape (N, segments + 1, 3), mm."""
        return self._nodes(poses)[0].reshape(len(poses), -1, 3)

    def motion(self, poses: Array) -> tuple[Array, Array]:
        """Tool origin in world, shape (N, 3), mm, and its Jacobian by joints, shape (N, 3, dof)."""
        position, jacobian = self._motion(poses)
        return position, jacobian


def skeleton(chain: Chain, setup: Setup, x: Array | None = None) -> Skeleton:
    """The arm with its nominal parameters, or with errors x in the order of the chain's parameters.

    A link runs along its two axes, first d then a (standard convention) or first a then d (Craig's), so that an offset
    elbow is where the metal is and not on the chord between the frames.
    """
    q = ca.SX.sym("q", chain.robot.dof)
    values = np.zeros(len(chain.parameters)) if x is None else x
    frames = setup.vector[:24]
    whole = ca.Function("frames", [chain.q, chain.x, chain.frames], [*chain.links, chain.tool, *_joint_columns(chain)])
    *poses, tool, jacobian = whole(q, values, frames)
    base = ca.SX(setup.base)
    nodes, links = [base[:3, 3]], []
    before = base
    for i, after in enumerate(poses, start=1):
        start, end = before[:3, 3], after[:3, 3]
        # z before the link carries d in the standard convention, x before it carries a in Craig's
        axis = before[:3, 2 if chain.robot.convention == "standard" else 0]
        nodes += [start + axis * ca.dot(axis, end - start), end]
        links += [i, i]
        before = after
    nodes.append(tool[:3, 3])
    links.append(chain.robot.dof + 1)

    def compiled(name: str, *outputs: ca.SX) -> BatchFunction:
        return batch_function(ca.Function(name, [q], ca.cse([ca.densify(ca.simplify(e)) for e in outputs])))

    return Skeleton(
        links=tuple(links),
        _tool=compiled("tool", tool),
        _nodes=compiled("nodes", ca.vertcat(*nodes)),
        _motion=compiled("motion", tool[:3, 3], jacobian),
    )


def _joint_columns(chain: Chain) -> list[ca.SX]:
    origin = chain.tool[:3, 3]
    return [ca.horzcat(*(screw.at(origin) for screw in chain.joint_screws))]
