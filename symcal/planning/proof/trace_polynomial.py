r"""tr(F(q) W F(q)^T) as a polynomial: degree two in (cos q_i, sin q_i) of revolute joints and in q_i of prismatic ones.

The rows of positions and poses are of degree one in every joint, because a chain is, as long as the noise is constant
in world or tool; their squares are then of degree two. Five angles around the circle or three lengths per joint
determine such a polynomial. That it is one is not assumed but tried, at random poses; joints that it does not depend
on (the first one, with noise that is the same in all directions) drop out by the same trial.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.kernels.instructions import Program, read_program
from symcal.planning.area import WorkingArea
from symcal.planning.proof import bernstein
from symcal.planning.proof.running_error import UNIT, evaluate
from symcal.planning.subspace_rows import SubspaceRows
from symcal.planning.worst_pose import PoseRows
from symcal.robot.robot import Joint

Array = NDArray[np.float64]

MOST = 100_000
"""Nodes that are affordable: seven revolute joints have 78 125."""

_TRIALS = 200  # random poses at which the polynomial is tried
_AGREED = 1e-9  # of its largest value
_ROUNDED = 1e-7  # of it: the margin for rounding, which grows with the joints, is to stay below what is to be proven
_BASES = 20  # random poses around which a joint is turned to see whether it matters
_IDLE = 1e-11  # of the largest value: a joint that changes less does not matter
_CHUNK = 2048  # poses at once, bounds the memory of rows with their errors
_ENTRY = 64  # rounding of an entry of a change of basis, in units of u and of the largest entry of its row


@dataclass(frozen=True, slots=True)
class Axis:
    """A joint that matters.

    ends: of equal pieces of its range, readings, shape (k + 1,). factor: angle per reading, positive.
    limits: whether the first piece begins and the last one ends at a limit; no where the range is a whole circle.
    """

    joint: int
    revolute: bool
    factor: float
    ends: Array
    limits: bool

    @property
    def pieces(self) -> int:
        return len(self.ends) - 1

    @property
    def nodes(self) -> Array:
        """Readings that determine the polynomial, shape (5,) or (3,)."""
        if self.revolute:
            return bernstein.angle_nodes() / self.factor
        return np.array([self.ends[0], 0.5 * (self.ends[0] + self.ends[-1]), self.ends[-1]])

    def change(self, piece: int) -> Array:
        """Values at the nodes -> convex coefficients over a piece, square."""
        if not self.revolute:
            return bernstein.from_lengths()
        return bernstein.from_angles(*(self.factor * self.ends[piece : piece + 2]))

    def halving(self, level: int) -> Array:
        """Coefficients over a piece that was halved ``level`` times -> over its lower half, square."""
        width = self.factor * (self.ends[1] - self.ends[0]) / 2**level
        return bernstein.halving(bernstein.ANGLE if self.revolute else bernstein.LENGTH, width)

    def cardinal(self, readings: Array) -> Array:
        """The polynomials that are one at one node and zero at the others, shape (N, nodes)."""
        if self.revolute:
            turned = self.factor * readings[:, None] - bernstein.angle_nodes()
            return np.asarray((1.0 + 2.0 * np.cos(turned) + 2.0 * np.cos(2.0 * turned)) / bernstein.ANGLE)
        t = (readings[:, None] - self.ends[0]) / (self.ends[-1] - self.ends[0])
        return np.concatenate([(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)], axis=1)


@dataclass(frozen=True, slots=True)
class TracePolynomial:
    """f(q) = tr(F W F^T) over a working area.

    axes: the joints that matter. values: f at all combinations of their nodes. errors: how far each of them may be from
    the exact one, same shape. departure: how far f was from the polynomial at random poses.
    """

    area: WorkingArea
    axes: tuple[Axis, ...]
    values: Array
    errors: Array
    departure: float

    def __call__(self, poses: Array) -> Array:
        """The polynomial at poses (N, dof), shape (N,)."""
        return _interpolate(self.axes, self.values, poses)

    def rounding(self, halvings: int) -> float:
        """How far a coefficient may be from the exact one, over any piece and after as many halvings of every joint."""
        entry = (_ENTRY + 2 * bernstein.ANGLE) * len(self.axes) * UNIT
        largest = self._reach(np.abs(self.values))
        return (
            self._reach(self.errors + entry * np.abs(self.values).max())
            + self.departure
            + (8 * halvings * len(self.axes) * UNIT * largest)
        )

    def _reach(self, sizes: Array) -> float:
        """The largest coefficient over any piece that values of these sizes can have."""
        for i, axis in enumerate(self.axes):
            size = np.max([np.abs(axis.change(k)) for k in range(axis.pieces)], axis=0)
            sizes = apply(size, sizes, i)
        return float(sizes.max())


def apply(matrix: Array, tensor: Array, axis: int) -> Array:
    """A matrix on one axis of a tensor."""
    shape = tensor.shape
    if axis == len(shape) - 1:  # one large product instead of many small ones
        return np.asarray(tensor.reshape(-1, shape[axis]) @ matrix.T).reshape(shape)
    flat = tensor.reshape(math.prod(shape[:axis]), shape[axis], -1)
    return np.asarray(np.matmul(matrix, flat)).reshape(shape)


def trace_polynomial(
    function: PoseRows, weight: Array, area: WorkingArea, joints: tuple[Joint, ...], rng: np.random.Generator
) -> TracePolynomial:
    """The polynomial.

    Args:
        weight: W, symmetric, shape (n, n). rng: of the poses at which it is tried.
    Raises:
        RefusedError: it is none, in a few words.
    """
    if not isinstance(function, SubspaceRows):
        raise RefusedError("which points of a target are seen changes from pose to pose")
    trace = _trace(function, weight)
    factors = np.where([joint.revolute for joint in joints], [abs(joint.ratio) for joint in joints], 1.0)
    trials = area.sample(rng, _TRIALS)
    trace(trials[:1])  # refuses what can be no polynomial, however many joints matter
    true = function.weighted(trials, weight)
    scale = float(np.abs(true).max())
    if not np.isfinite(scale):
        raise RefusedError("the information of a pose is not finite everywhere")
    moving = [i for i in range(area.dof) if area.span[i] > 0 and _matters(trace, area, i, scale, rng)]
    axes = tuple(_axis(i, joints[i], float(factors[i]), area) for i in moving)
    shape = tuple(len(axis.nodes) for axis in axes)
    if math.prod(shape) > MOST:
        raise RefusedError(f"{len(axes)} joints matter, which is out of reach")
    values, errors = _at_nodes(trace, area, axes)
    if errors.max() > _ROUNDED * scale:
        raise RefusedError("the information is so nearly singular that rounding is as large as what is to be proven")
    departure = float(np.abs(_interpolate(axes, values, trials) - true).max())
    if departure > _AGREED * scale:
        raise RefusedError(
            "the information of a pose is of more than degree two in the joints' sines and cosines, as with joint terms"
        )
    return TracePolynomial(area, axes, values, errors, departure)


@dataclass(frozen=True, slots=True)
class _Trace:
    """tr(F W F^T) with bounds of its rounding errors. lifted: V W V^T; size: |V| |W| |V|^T, shape (p, p)."""

    program: Program
    lifted: Array
    size: Array
    sums: float

    def __call__(self, poses: Array) -> tuple[Array, Array]:
        """Values and bounds of their errors, shape (N,)."""
        rows, doubt = evaluate(self.program, poses)
        values = np.einsum("kmp,kmp->k", rows @ self.lifted, rows)
        reach = np.abs(rows)
        inner = (self.sums * reach + (2 + self.sums) * doubt) @ self.size
        errors = np.einsum("kmp,kmp->k", inner, reach) + np.einsum("kmp,kmp->k", doubt @ self.size, doubt)
        return values, 1.01 * errors


def _trace(function: SubspaceRows, weight: Array) -> _Trace:
    v, p = np.abs(function.basis), len(function.basis)
    sums = (p + function.components * p + 2 * len(weight) + 16) * UNIT
    lifted = function.basis @ weight @ function.basis.T
    return _Trace(read_program(function.expression), lifted, v @ np.abs(weight) @ v.T, sums)


def _matters(trace: _Trace, area: WorkingArea, i: int, scale: float, rng: np.random.Generator) -> bool:
    """Whether turning a joint changes the trace by more than rounding can."""
    poses = np.repeat(area.sample(rng, _BASES)[None], bernstein.ANGLE, axis=0)
    poses[:, :, i] = np.linspace(area.lower[i], area.upper[i], bernstein.ANGLE)[:, None]
    values, errors = trace(poses.reshape(-1, area.dof))
    change = float(np.ptp(values.reshape(bernstein.ANGLE, -1), axis=0).max())
    return bool(change > max(_IDLE * scale, min(2 * float(errors.max()), _AGREED * scale)))


def _axis(i: int, joint: Joint, factor: float, area: WorkingArea) -> Axis:
    low, high = float(area.lower[i]), float(area.upper[i])
    if not joint.revolute:
        return Axis(i, False, 1.0, np.array([low, high]), True)
    turn = 2 * np.pi / factor
    whole = high - low >= turn * (1 - 1e-9)
    if whole:  # a whole circle has no ends, and what is beyond it is the same again
        high = low + turn
    pieces = max(int(np.ceil((high - low) * factor / bernstein.WIDEST)), 1)
    return Axis(i, True, factor, np.linspace(low, high, pieces + 1), not whole)


def _at_nodes(trace: _Trace, area: WorkingArea, axes: tuple[Axis, ...]) -> tuple[Array, Array]:
    """f at all nodes and bounds of its rounding errors, both of the tensor's shape."""
    shape = tuple(len(axis.nodes) for axis in axes)
    values, errors = zip(*(trace(poses) for poses in _node_poses(area, axes, shape)), strict=True)
    return np.concatenate(values).reshape(shape), np.concatenate(errors).reshape(shape)


def _node_poses(area: WorkingArea, axes: tuple[Axis, ...], shape: tuple[int, ...]) -> Iterator[Array]:
    for start in range(0, math.prod(shape), _CHUNK):
        which = np.unravel_index(np.arange(start, min(start + _CHUNK, math.prod(shape))), shape) if shape else ()
        poses = np.tile(0.5 * (area.lower + area.upper), (len(which[0]) if shape else 1, 1))
        for axis, index in zip(axes, which, strict=True):
            poses[:, axis.joint] = axis.nodes[index]
        yield poses


def _interpolate(axes: tuple[Axis, ...], values: Array, poses: Array) -> Array:
    if not axes:
        return np.full(len(poses), values.item())
    first = axes[0].cardinal(poses[:, axes[0].joint])
    out = first @ values.reshape(first.shape[1], -1)
    for axis in axes[1:]:
        basis = axis.cardinal(poses[:, axis.joint])
        out = np.matmul(basis[:, None, :], out.reshape(len(poses), basis.shape[1], -1))[:, 0]
    return np.asarray(out.reshape(len(poses)))
