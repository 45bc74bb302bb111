r"""Rows of poses as `SubspaceRows` has them, where many points of one piece are read: what a plan knows of a board.

The rows of a pose are those of the points that can be read there at nominal, compressed to a triangle. Values and
derivatives of tr(F W F^T) need no triangle: with A the whitened slopes by twist and own numbers, and M the screws and
unit rows by the scaled parameters,

    tr(F W F^T) = tr(G N),    G = A^T A,  N = M W M^T;        d/dA = 2 A N,   d/dM = 2 G M W

and the chain rule goes on through both stages (`symcal.model.stages`). Which points can be read is taken as it is at
the pose.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.kernels import BatchFunction, batch_function
from symcal.model.contact import TOUCHING
from symcal.model.measurement import Measurement, Part, Setup
from symcal.model.staged_kernel import StagedKernel, Twists
from symcal.planning.subspace_rows import SubspaceRows, subspace_rows

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StagedRows:
    """F(q) = J(q) V of several observations, some of them in stages; made by `measured_rows`.

    written: rows of those that are written out, whitened and scaled; None without any. staged: the others.
    basis: V, shape (p, n).
    """

    written: SubspaceRows | None
    staged: tuple[_Staged, ...]
    basis: Array

    @property
    def components(self) -> int:
        """Rows of a pose."""
        return (0 if self.written is None else self.written.components) + sum(each.components for each in self.staged)

    def full(self, poses: Array) -> Array:
        """J at each pose, shape (N, m, p)."""
        first = [] if self.written is None else [self.written.full(poses)]
        return np.concatenate([*first, *(each.full(poses) for each in self.staged)], axis=1)

    def rows(self, poses: Array) -> Array:
        """F at each pose, shape (N, m, n)."""
        return np.asarray(self.full(poses) @ self.basis)

    def weighted(self, poses: Array, weight: Array) -> Array:
        """tr(F W F^T) at each pose, shape (N,)."""
        lifted = self.basis @ weight @ self.basis.T
        out = np.zeros(len(poses)) if self.written is None else self.written.weighted(poses, lifted)
        return np.asarray(out + np.sum([each.weighted(poses, lifted) for each in self.staged], axis=0))

    def weighted_gradient(self, poses: Array, weight: Array) -> tuple[Array, Array]:
        """tr(F W F^T), shape (N,), and its derivative by the joint readings, shape (N, dof)."""
        lifted = self.basis @ weight @ self.basis.T
        found = [each.weighted_gradient(poses, lifted) for each in self.staged]
        if self.written is not None:
            found.append(self.written.weighted_gradient(poses, lifted))
        return np.sum([value for value, _ in found], axis=0), np.sum([slope for _, slope in found], axis=0)

    def on(self, basis: Array) -> StagedRows:
        """The same rows on another subspace."""
        return replace(self, basis=basis)


@dataclass(frozen=True, slots=True)
class _Staged:
    """Rows of one observation in stages, at nominal.

    setup: vector of the setup. x: zero errors. sigma: of every component, shape (K s,). index, scales: of the p free
    parameters. needed: points that must be read for any to count.
    """

    kernel: StagedKernel
    setup: Array
    x: Array
    sigma: Array
    index: NDArray[np.intp]
    scales: Array
    needed: int
    pose_pullback: BatchFunction
    point_pullback: BatchFunction

    @property
    def components(self) -> int:
        return min(len(self.sigma), 6 + len(self.kernel.columns))

    def full(self, poses: Array) -> Array:
        return np.concatenate([self._triangles(part) for part in self._parts(poses)])

    def weighted(self, poses: Array, lifted: Array) -> Array:
        return np.concatenate([self._values(part, lifted) for part in self._parts(poses)])

    def weighted_gradient(self, poses: Array, lifted: Array) -> tuple[Array, Array]:
        found = [self._gradient(part, lifted) for part in self._parts(poses)]
        return np.concatenate([value for value, _ in found]), np.concatenate([slope for _, slope in found])

    def _parts(self, poses: Array) -> Iterator[Array]:
        for start in range(0, max(len(poses), 1), self.kernel.chunk):
            yield poses[start : start + self.kernel.chunk]

    def _seen(self, poses: Array) -> NDArray[np.bool_]:
        """Which points can be read, shape (N, K)."""
        seen = (self.kernel.margins(poses, self.x, self.setup) > 0).all(axis=2)
        return np.asarray(seen & (seen.sum(axis=1) >= self.needed)[:, None])

    def _triangles(self, poses: Array) -> Array:
        twists = self.kernel.slopes(poses, self.x, self.setup, self._seen(poses))
        spread = np.broadcast_to(self.sigma, twists.r.shape)
        rows = twists.packed(spread, self.index)[:, : self.components, :-1]
        return np.asarray(rows * self.scales)

    def _factors(self, poses: Array, seen: NDArray[np.bool_]) -> tuple[Twists, Array, Array]:
        """Slopes, A (N, K s, 6 + k) and the first six rows of M, (N, 6, p)."""
        twists = self.kernel.slopes(poses, self.x, self.setup, seen)
        whitened = np.concatenate([twists.by_twist, twists.by_own], axis=2) / self.sigma[:, None]
        return twists, whitened, twists.screws[:, :, self.index] * self.scales

    def _unit_rows(self) -> Array:
        """The other rows of M, the same at all poses, shape (k, p): zero for an own number that is not free."""
        return np.asarray((self.kernel.columns[:, None] == self.index) * self.scales)

    def _inner(self, screws: Array, lifted: Array) -> tuple[Array, Array, Array]:
        """N, (N, 6 + k, 6 + k), and the rows of M W: six of each pose, (N, 6, p), and what is the same, (k, p)."""
        unit = self._unit_rows()
        six, same = screws @ lifted, unit @ lifted
        inner = np.empty((len(screws), 6 + len(unit), 6 + len(unit)))
        np.matmul(six, screws.swapaxes(1, 2), out=inner[:, :6, :6])
        np.matmul(six, unit.T, out=inner[:, :6, 6:])
        inner[:, 6:, :6] = inner[:, :6, 6:].swapaxes(1, 2)
        inner[:, 6:, 6:] = same @ unit.T
        return inner, six, same

    def _values(self, poses: Array, lifted: Array) -> Array:
        _, whitened, screws = self._factors(poses, self._seen(poses))
        return np.asarray(np.einsum("nij,nij->n", whitened @ self._inner(screws, lifted)[0], whitened))

    def _gradient(self, poses: Array, lifted: Array) -> tuple[Array, Array]:
        seen = self._seen(poses)
        _, whitened, screws = self._factors(poses, seen)
        inner, six, same = self._inner(screws, lifted)
        spread = whitened @ inner
        value = np.einsum("nij,nij->n", spread, whitened)
        by_slopes = 2.0 * spread / self.sigma[:, None]
        gram = whitened[:, :, :6].swapaxes(1, 2) @ whitened
        by_six = 2.0 * (gram[:, :, :6] @ six + gram[:, :, 6:] @ same) * self.scales
        by_screws = np.zeros((len(poses), 6, len(self.x)))
        by_screws[:, :, self.index] = by_six
        place, _, own, _ = self.kernel.pose(poses, self.x, self.setup)
        pose, point = np.nonzero(seen)
        adjoint = by_slopes.reshape(*seen.shape, -1, by_slopes.shape[2])[pose, point]
        numbers = own[0] if len(own) else np.zeros(own.shape[1])
        by_place = np.zeros(place.shape)
        if len(pose):
            (each,) = self.point_pullback(place[pose], self.kernel.points[point], numbers, adjoint)
            np.add.at(by_place, pose, each)
        (slope,) = self.pose_pullback(poses, self.x, self.setup, by_place, by_screws)
        return value, np.asarray(slope)


def measured_rows(
    measurement: Measurement, setup: Setup, sigma: Array, index: NDArray[np.intp], scales: Array
) -> SubspaceRows | StagedRows:
    """Rows Sigma^-1/2 J S of a measurement at nominal, on the whole parameter space.

    Args:
        sigma: of every component, shape (m,). index, scales: of the free parameters, shape (p,).
    """
    written = [part for part in measurement.parts if part.staged is None]
    rows = None
    if written:
        own = np.concatenate([sigma[part.components] for part in written])
        q = ca.SX.sym("q", measurement.chain.robot.dof)
        at_nominal = measurement.jacobian(q, np.zeros(len(measurement.parameters)), setup.vector)
        read = ca.vertcat(*(_read(part, q, setup) for part in written))
        scaled = ca.diag(read / own) @ at_nominal[:, index.tolist()] @ ca.diag(scales)
        rows = subspace_rows("rows", q, scaled, np.eye(len(index)))
        if len(written) == len(measurement.parts):
            return rows
    staged = tuple(
        _staged(part, part.staged, setup, np.zeros(len(measurement.parameters)), sigma[part.components], index, scales)
        for part in measurement.parts
        if part.staged is not None
    )
    return StagedRows(rows, staged, np.eye(len(index)))


def _read(part: Part, q: ca.SX, setup: Setup) -> ca.SX:
    """One for each component that a posture gives, zero for those of a constraint that it does not touch, (m,)."""
    if part.contact is None:
        return ca.SX.ones(part.size)
    c = part.contact(q, np.zeros(part.contact.size1_in("x")), setup.vector)[0]
    return ca.if_else(ca.norm_2(c) < TOUCHING, 1.0, 0.0) * ca.SX.ones(part.size)


def _staged(
    part: Part,
    kernel: StagedKernel,
    setup: Setup,
    x: Array,
    sigma: Array,
    index: NDArray[np.intp],
    scales: Array,
) -> _Staged:
    needed = part.observation.target.needed
    pullbacks = _pose_pullback(kernel.pose.function), _point_pullback(kernel.planned.function)
    made = (batch_function(each) for each in pullbacks)
    return _Staged(kernel, setup.vector, x, sigma, index, scales, needed, *made)


def _pose_pullback(pose: ca.Function) -> ca.Function:
    """(q, x, setup, adjoints of place and S) -> the gradient by q of what they are adjoints of."""
    q, x, setup = (ca.SX.sym(pose.name_in(i), pose.size1_in(i)) for i in range(3))
    place, _, _, screws = pose(q, x, setup)
    by_place, by_screws = ca.SX.sym("by_place", 12), ca.SX.sym("by_S", *screws.shape)
    inner = ca.dot(place, by_place) + ca.dot(ca.vec(screws), ca.vec(by_screws))
    slope = ca.cse(ca.densify(ca.gradient(inner, q)))
    return ca.Function("pose_pullback", [q, x, setup, by_place, by_screws], [slope])


def _point_pullback(planned: ca.Function) -> ca.Function:
    """(place, c, own, adjoint of [J_twist J_own]) -> the gradient by the place."""
    place, c, own = (ca.SX.sym(planned.name_in(i), planned.size1_in(i)) for i in range(3))
    slopes = ca.horzcat(*planned(place, c, own))
    adjoint = ca.SX.sym("adjoint", *slopes.shape)
    slope = ca.cse(ca.densify(ca.gradient(ca.dot(ca.vec(slopes), ca.vec(adjoint)), place)))
    return ca.Function("point_pullback", [place, c, own, adjoint], [slope])
