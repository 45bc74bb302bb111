r"""Residuals of a dataset whose poses are displaced by a Gaussian process: correlated noise, whitened.

With D_n the slopes of a position residual by a displacement of the flange along the axes of the base (a rotation) and
b(q) functions of unit variance (`symcal.joints.remainder`), displacements D_n b_n^T t, t ~ N(0, rho sigma^2), add to
noise of variance sigma^2. In the axes of the base all three components of P_n points of a pose have the same
covariance; their mean times sqrt(P_n) has sigma^2 (I + rho G B B^T G), G = diag(sqrt(P_n)), and differences between
points of a pose have sigma^2 alone. With the thin singular value decomposition G B = Q diag(s) V^T,

    (I + rho G B B^T G)^-1/2 = I + Q (diag(1 + rho s^2)^-1/2 - I) Q^T

is applied to residuals and slopes; what is left is noise of variance sigma^2. The estimate of a model by these rows is
generalised least squares, and its marginal likelihood, with 3 sum log(1 + rho s^2) added to -2 log L, that of the model
with the process integrated out ([Rasmussen2006] sec. 2.7, without its vague limit).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from symcal.fit.residual_rows import Linear, Rows

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Field:
    """How the displacements of N poses hang together; made by `field_of`.

    columns: of the residual, by point, shape (P, 3). turns: D, shape (N, P, 3, 3), zero where a point was not measured.
    roots: sqrt(P_n), shape (N,). q: Q, (N, k). s: (k,). v: V, (M, k).
    """

    columns: NDArray[np.intp]
    turns: Array
    roots: Array
    q: Array
    s: Array
    v: Array

    def mean(self, values: Array) -> Array:
        """What the points of a pose share, times sqrt(P_n), in the axes of the base.

        Args:
            values: residuals (N, m) or slopes (N, m, n).
        Returns:
            shape (N, 3) or (N, 3, n).
        """
        turned = np.einsum("npij,npi...->nj...", self.turns, values[:, self.columns])
        return np.asarray(turned / _by_pose(self.roots, turned))

    def whitened(self, values: Array, ratio: float) -> Array:
        """Residuals or slopes with the displacements whitened. ratio: rho."""
        mean = self.mean(values)
        flat = mean.reshape(len(mean), -1)
        change = self.q @ ((1 / np.sqrt(1 + ratio * self.s**2) - 1)[:, None] * (self.q.T @ flat))
        share = change.reshape(mean.shape) / _by_pose(self.roots, mean)
        out = values.copy()
        out[:, self.columns] += np.einsum("npij,nj...->npi...", self.turns, share)
        return out

    def parts(self, values: Array) -> tuple[Array, Array]:
        """Values split by orthogonal rows: those along Q, shape (k, 3 n), which whitening divides by
        sqrt(1 + rho s^2), and others with the squared norms of what it leaves alone, (h, n), for slopes (N, m, n)."""
        mean = self.mean(values)
        along = self.q.T @ mean.reshape(len(mean), -1)
        share = (self.q @ along).reshape(mean.shape) / _by_pose(self.roots, mean)
        left = values[:, self.columns] - np.einsum("npij,nj...->npi...", self.turns, share)
        measured = self.turns.any(axis=(2, 3))
        rows = left[measured].reshape(-1, values.shape[2])
        _, size, directions = np.linalg.svd(rows, full_matrices=False)
        kept = min(len(size), max(len(rows) - 3 * len(self.s), 0))
        return along, size[:kept, None] * directions[:kept]

    def coefficients(self, values: Array, ratio: float) -> Array:
        """Posterior mean of t where values are what is displaced, shape (M, 3) or (M, 3, n)."""
        mean = self.mean(values)
        shrunk = (ratio * self.s / (1 + ratio * self.s**2))[:, None] * (self.q.T @ mean.reshape(len(mean), -1))
        return np.asarray((self.v @ shrunk).reshape(len(self.v), *mean.shape[1:]))

    def log_determinant(self, ratio: float) -> float:
        """What whitening takes from -2 log L."""
        return 3 * float(np.log1p(ratio * self.s**2).sum())

    def told(self, ratio: float) -> Array:
        """Share of the variance along each column of V that the data tell, shape (k,)."""
        return np.asarray(ratio * self.s**2 / (1 + ratio * self.s**2))


def _by_pose(values: Array, like: Array) -> Array:
    return values.reshape(-1, *(1,) * (like.ndim - 1))


def field_of(columns: NDArray[np.intp], turns: Array, basis: Array) -> Field:
    """The field of poses.

    Args:
        turns: as in `Field`. basis: b of the poses, shape (N, M).
    """
    roots = np.sqrt(np.maximum(turns.any(axis=(2, 3)).sum(axis=1), 1.0))
    measured = turns.any(axis=(1, 2, 3))
    q, s, vt = np.linalg.svd((roots * measured)[:, None] * basis, full_matrices=False)
    return Field(columns, turns, roots, q, s, vt.T)


@dataclass(frozen=True, slots=True)
class CorrelatedRows(Rows):
    """Rows with the displacements of a field whitened."""

    displaced: Field | None = None
    ratio: float = 0.0

    @property
    def many(self) -> bool:
        """A field ties all poses together: they come at once."""
        return False

    def __call__(self, x: Array) -> tuple[Array, Array]:
        r, jacobian = self._evaluated(x)
        r, jacobian = np.where(self.seen, r, 0.0), np.where(self.seen[:, :, None], jacobian, 0.0)
        if self.displaced is None:
            return r, jacobian
        return self.displaced.whitened(r, self.ratio), self.displaced.whitened(jacobian, self.ratio)


def correlated(rows: Rows, displaced: Field, ratio: float) -> CorrelatedRows:
    """Rows with a field."""
    own = (rows.measurement, rows.data, rows.setup, rows.kernels, rows.poses, rows.z, rows.seen)
    return CorrelatedRows(*own, unplaced=rows.unplaced, displaced=displaced, ratio=ratio)


@dataclass(frozen=True, slots=True)
class FrozenRows(Rows):
    """Rows linearised once and for all, whatever x: searches over variances ask for the same again and again."""

    linear: Linear = field(default_factory=lambda: Linear(np.zeros((0, 0)), ()))

    @property
    def many(self) -> bool:
        """They are held anyway."""
        return False

    def at(self, x: Array) -> Linear:  # noqa: ARG002
        return self.linear
