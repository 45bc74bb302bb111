r"""How far two robots put the tool apart, over the joint ranges: what a difference of parameters comes to.

    e(q) = B p_b(q; t) - p_a(q),      min over B, t of sum |e|^2

p are positions of the tool in base. Where a set-up finds base or tool from its own measurements, B, one rigid motion,
and t, where the tool's point is on the flange, are fitted first: an instrument or a tool that was put elsewhere is no
change of the robot. To first order, e = Q (J d) with Q the projection off what B and t can do, so that from
the covariance of d equal robots are expected to be apart by sqrt(tr(Q J cov(d) J^T Q) / N). Ours.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal import kinematics, spatial
from symcal.kernels import batch_function
from symcal.model.parameter_set import parameter_set
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

_POSTURES = 1000
_STEPS = 20
_STILL = 1e-9  # mm: rms of a step's motion that ends the alignment
_NULL = 1e-10  # share of the largest singular value: a motion that moves nothing


@dataclass(frozen=True, slots=True, eq=False)
class ToolDifference:
    """Distances in mm of two robots' tools over postures drawn uniformly between the joint limits.

    rms, p95, largest: found. expected: rms that two calibrations of one robot would show. at: readings of the largest,
    shape (dof,). aligned: what was fitted first, of `base` and `tool`.
    """

    rms: float
    p95: float
    largest: float
    expected: float
    at: Array
    aligned: tuple[str, ...]


def tool_difference(
    first: Robot, second: Robot, names: Sequence[str], covariance: Array, loose: Collection[str]
) -> ToolDifference:
    """How far the tool of the second robot is from that of the first.

    Args:
        names: the parameters whose difference has this ``covariance``, shape (n, n), mm and rad. loose: what is fitted
            first, of `base` and `tool`; what is not is taken as the robots have it.
    """
    q = np.random.default_rng(0).uniform(*first.ranges, (_POSTURES, first.dof))
    bases = [np.eye(4)] * 2 if "base" in loose else [first.base, second.base]
    tools = [first.tool, first.tool if "tool" in loose else second.tool]
    (pose, jacobian, known), (other, *_) = (
        _flange(robot, q, base, tool) for robot, base, tool in zip((first, second), bases, tools, strict=True)
    )
    at = pose[:, :3, 3]
    apart = _aligned(other, at, loose)
    index = [known.index(name) for name in names]
    flat = _without(_motions(pose, loose), jacobian[:, :, index].reshape(3 * len(q), len(index)))
    sizes = np.linalg.norm(apart, axis=1)
    return ToolDifference(
        float(np.sqrt(np.mean(sizes**2))),
        float(np.percentile(sizes, 95)),
        float(sizes.max()),
        float(np.sqrt(max(np.sum((flat @ covariance) * flat), 0.0) / len(q))),
        q[int(sizes.argmax())],
        tuple(part for part in ("base", "tool") if part in loose),
    )


def _flange(robot: Robot, q: Array, base: Array, tool: Array) -> tuple[Array, Array, tuple[str, ...]]:
    """Poses of the tool (N, 4, 4), slopes of its position by the robot's parameters (N, 3, n), and their names."""
    parameters = parameter_set(robot)
    kernel = batch_function(kinematics.forward(kinematics.chain(robot, parameters)), evaluations=0)
    pose, _, jacobian = kernel(q, np.zeros(len(parameters)), kinematics.frame_vector(base, tool))
    return pose, jacobian[:, :3], parameters.names


def _aligned(pose: Array, wanted: Array, loose: Collection[str]) -> Array:
    """Positions less the wanted ones, shape (N, 3), after the best motion of base and tool."""
    moved = pose.copy()
    for _ in range(_STEPS if loose else 0):
        motions = _motions(moved, loose)
        step = np.linalg.lstsq(motions, (wanted - moved[:, :3, 3]).ravel(), rcond=_NULL)[0]
        if np.sqrt(np.mean((motions @ step) ** 2)) < _STILL:
            break
        base = np.asarray(step[:6] if "base" in loose else np.zeros(6), dtype=np.float64)
        point = step[-3:] if "tool" in loose else np.zeros(3)
        moved[:, :3, 3] += moved[:, :3, :3] @ point
        moved = spatial.transform(spatial.vector_matrix(base[3:]), base[:3]) @ moved
    return np.asarray(moved[:, :3, 3] - wanted)


def _motions(pose: Array, loose: Collection[str]) -> Array:
    """How positions move with base (three shifts, three turns) and with the tool's point, shape (3 N, k)."""
    at, unit = pose[:, :3, 3], np.broadcast_to(np.eye(3), (len(pose), 3, 3))
    turns = np.cross(np.eye(3), at[:, None]).swapaxes(1, 2)
    parts = [unit, turns] * ("base" in loose) + [pose[:, :3, :3]] * ("tool" in loose)
    return np.concatenate(parts, axis=2).reshape(3 * len(pose), -1) if parts else np.zeros((3 * len(pose), 0))


def _without(motions: Array, rows: Array) -> Array:
    """Rows (k, n) less what combinations of the motions (k, m) can do."""
    if not motions.shape[1]:
        return rows
    left, size, _ = np.linalg.svd(motions / np.maximum(np.linalg.norm(motions, axis=0), 1e-300), full_matrices=False)
    basis = left[:, size > _NULL * size[0]]
    return np.asarray(rows - basis @ (basis.T @ rows))
