"""Jacobian rows as a function of the joint readings, on the identifiable subspace, with exact derivatives in batch.

Information of a pose and predicted error at a pose are the same computation on different rows: tr(F(q) W F(q)^T) for a
symmetric W. This is its one place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.kernels import BatchFunction, batch_function

Array = NDArray[np.float64]

_CHUNK = 8192  # poses at once: bounds the memory of a dense search


@dataclass(frozen=True, slots=True)
class SubspaceRows:
    """F(q) = J(q) V, made by `subspace_rows`.

    expression: q -> J, shape (m, p), a function of SX. basis: V, shape (p, n).
    """

    expression: ca.Function
    basis: Array
    _rows: BatchFunction
    _pullback: BatchFunction

    @property
    def components(self) -> int:
        """Rows of a pose."""
        return int(self.expression.size1_out(0))

    def full(self, poses: Array) -> Array:
        """J at each pose, shape (N, m, p); poses (N, dof) in rad or mm."""
        return np.asarray(self._rows(poses)[0])

    def rows(self, poses: Array) -> Array:
        """F at each pose, shape (N, m, n)."""
        return np.asarray(self._rows(poses)[0] @ self.basis)

    def weighted(self, poses: Array, weight: Array) -> Array:
        """tr(F W F^T) at each pose, shape (N,), for a symmetric W, shape (n, n)."""
        lifted = self.basis @ weight @ self.basis.T
        return np.concatenate([_traces(self._rows(part)[0], lifted) for part in _parts(poses)])

    def weighted_gradient(self, poses: Array, weight: Array) -> tuple[Array, Array]:
        """tr(F W F^T), shape (N,), and its exact derivative by the joint readings, shape (N, dof)."""
        jacobian = self._rows(poses)[0]
        adjoint = 2.0 * (jacobian @ (self.basis @ weight @ self.basis.T))
        return 0.5 * np.einsum("kmp,kmp->k", adjoint, jacobian), np.asarray(self._pullback(poses, adjoint)[0])

    def on(self, basis: Array) -> SubspaceRows:
        """The same rows on another subspace."""
        return SubspaceRows(self.expression, basis, self._rows, self._pullback)


def subspace_rows(name: str, q: ca.SX, jacobian: ca.SX, basis: Array) -> SubspaceRows:
    """Rows from an expression of the joint readings.

    Args:
        q: shape (dof,). jacobian: J(q), shape (m, p). basis: V, shape (p, n).
    """
    dense = ca.densify(ca.simplify(jacobian))
    adjoint = ca.SX.sym("adjoint", *dense.shape)
    slope = ca.densify(ca.gradient(ca.sum1(ca.sum2(dense * adjoint)), q))
    expression = ca.Function(name, [q], [ca.cse(dense)], ["q"], ["J"])
    pullback = ca.Function(f"{name}_pullback", [q, adjoint], [ca.cse(slope)], ["q", "adjoint"], ["g"])
    return SubspaceRows(expression, basis, batch_function(expression), batch_function(pullback))


def _parts(poses: Array) -> Iterator[Array]:
    for start in range(0, max(len(poses), 1), _CHUNK):
        yield poses[start : start + _CHUNK]


def _traces(rows: Array, weight: Array) -> Array:
    return np.asarray(np.einsum("kmp,kmp->k", rows @ weight, rows))
