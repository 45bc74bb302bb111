r"""The difference of two estimates from disjoint data, and its law.

Half i has whitened rows [J_i r_i], both share [P p] of what is known beforehand. With

    A_i = c J_i^T J_i + P^T P,    C_i = A_i^-1,    y_i = -C_i (J_i^T r_i + P^T p),

and errors e_1, e_2, e_0 of all rows about the truth (e_0: of the truth about what is known beforehand),

    y_1 - y_2 = -C_1 J_1^T e_1 + C_2 J_2^T e_2 - (C_1 - C_2) P^T e_0,
    cov = m (C_1 J_1^T J_1 C_1 + C_2 J_2^T J_2 C_2) + (C_1 - C_2) P^T P (C_1 - C_2),

which for c = m = 1 is C_1 + C_2 - C_1 L C_2 - C_2 L C_1, L = P^T P: less than the sum of the two posterior covariances
by what both have from the same prior. Along a direction that neither half sees both stay where the prior has them, and
do not differ at all. Moving the truth moves both estimates alike, so the difference is a function of the residuals of
the fit of both, and its squared norm T in units of its covariance is that of their projection on r directions: chi^2_r
where the noise is known, and where it was estimated from nu degrees of freedom of those same residuals T / nu is
Beta(r / 2, (nu - r) / 2), as for the test of [Chow1960], which this is without a prior. Where each estimate comes with
a noise of its own, T / r is as Fisher's F of r and nu instead. The prior in it is ours. With several noise groups nu is
that of their sum ([Satterthwaite1946]).

c and m are 1 but for robust losses (`symcal.fit.sandwich`): rows then have their weights, and m is the variance of what
a weighted reading pulls by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEAST = 1e-4
"""Share of the largest variance below which a direction of a difference is left out: a hundredth of the largest
standard deviation at the tool is nothing there, and smaller than what linearising leaves."""
_LEFT = 1.0  # degrees of freedom that must be left beside the directions that are tested
_ALL = 1e-14  # of a share: as good as all


@dataclass(frozen=True, slots=True)
class HalfRows:
    """Whitened rows of a fit, linearised at its estimate.

    slopes: J, shape (k, n); r: shape (k,); pose, group: of which pose and noise group, shape (k,). known: [P p], shape
    (l, n + 1). dof: nu of every noise group; infinite where the noise is stated. bread, meat: c and m by noise group.
    """

    slopes: Array
    r: Array
    pose: NDArray[np.intp]
    group: NDArray[np.intp]
    known: Array
    dof: Sequence[float]
    bread: Sequence[float]
    meat: Sequence[float]


@dataclass(frozen=True, slots=True)
class Difference:
    """The law of y_1 - y_2, and its value for the linear model; made by `difference`.

    step: y_1 - y_2 of the linear model, shape (n,). covariance: shape (n, n). parts: of it, by noise group, and last
    what comes from the prior, shape (g + 1, n, n). together: the noise was told from the residuals of a fit of both, in
    which the difference is; otherwise from those of each.
    """

    step: Array
    covariance: Array
    parts: Array
    dof: Sequence[float]
    together: bool

    def tested(self, step: Array, metric: Array) -> Tested | None:
        """T of a difference, in the directions that matter to a metric.

        Args:
            step: y_1 - y_2, shape (n,). metric: M, shape (n, n); directions whose variance in it is below 1e-4 of the
                largest are left out.
        Returns:
            None where no direction matters, or too little is left to tell the noise by.
        """
        size, axes = np.linalg.eigh(metric)
        root = np.sqrt(np.maximum(size, 0.0))[:, None] * axes.T
        variance, turned = np.linalg.eigh(root @ self.covariance @ root.T)
        kept = np.flatnonzero(variance > _LEAST * variance[-1]) if variance[-1] > 0 else np.zeros(0, dtype=np.intp)
        r = len(kept)
        if not r:
            return None
        whiten = (turned[:, kept] / np.sqrt(variance[kept])).T @ root
        shares = np.einsum("ri,gij,rj->g", whiten, self.parts[:-1], whiten) / r
        inverse = float(np.sum(shares**2 / np.asarray(self.dof)))
        squares = float(np.sum((whiten @ step) ** 2))
        if inverse == 0:
            return Tested(squares, r, np.inf, float(scipy.special.chdtrc(r, squares)))
        nu = 1 / inverse
        if not self.together:
            return Tested(squares, r, nu, float(scipy.special.fdtrc(r, nu, squares / r)))
        if nu - r < _LEFT:
            return None
        return Tested(squares, r, nu, float(scipy.special.betaincc(r / 2, (nu - r) / 2, min(squares / nu, 1 - _ALL))))


@dataclass(frozen=True, slots=True)
class Tested:
    """squares: T. directions: r. dof: nu, infinite where all noise is stated. p: of a larger T by chance."""

    squares: float
    directions: int
    dof: float
    p: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """One of two estimates.

    y: shape (n,). inverse: C, shape (n, n). scatter: m C J^T J C, what the noise of its data makes, by noise group,
    shape (g, n, n). dof: as in `HalfRows`.
    """

    y: Array
    inverse: Array
    scatter: Array
    dof: Sequence[float]


def estimate_of(rows: HalfRows, own: Mask) -> Estimate:
    """The estimate from some poses of a fit, shape (N,), to first order about where its rows were linearised."""
    known, prior = rows.known[:, :-1], rows.known[:, -1]
    kept = own[rows.pose]
    j, r, group = rows.slopes[kept], rows.r[kept], rows.group[kept]
    steep = j * np.sqrt(np.asarray(rows.bread))[group][:, None]
    triangle = np.asarray(np.linalg.qr(np.vstack([steep, known]), mode="r"), dtype=np.float64)
    root = scipy.linalg.solve_triangular(triangle, np.eye(j.shape[1]))
    inverse = np.asarray(root @ root.T)
    pulled = [j[group == g] @ inverse for g in range(len(rows.dof))]
    scatter = np.array([m * (each.T @ each) for m, each in zip(rows.meat, pulled, strict=True)])
    return Estimate(-inverse @ (j.T @ r + known.T @ prior), inverse, scatter, rows.dof)


def difference(rows: HalfRows, first: Mask) -> Difference:
    """The difference of the estimates of two halves.

    Args:
        first: which poses are of the first half, shape (N,); the others are of the second.
    """
    one, other = estimate_of(rows, first), estimate_of(rows, ~first)
    scatter = one.scatter + other.scatter
    return _law(one, other, scatter, rows.dof, rows.known[:, :-1], together=True)


def difference_of(one: Estimate, other: Estimate, known: Array) -> Difference:
    """The difference of two estimates whose noise was told each from its own data.

    Args:
        known: P, what both know beforehand, shape (l, n).
    """
    scatter = np.concatenate([one.scatter, other.scatter])
    return _law(one, other, scatter, [*one.dof, *other.dof], known, together=False)


def _law(
    one: Estimate, other: Estimate, scatter: Array, dof: Sequence[float], known: Array, *, together: bool
) -> Difference:
    held = known @ (one.inverse - other.inverse)
    parts = np.concatenate([scatter, (held.T @ held)[None]])
    return Difference(one.y - other.y, parts.sum(axis=0), parts, dof, together)


def at_least_one(p: float, count: int) -> float:
    """Probability that the least of so many p-values is as small by chance, as if independent ([Sidak1967])."""
    return float(-np.expm1(count * np.log1p(-min(p, 1 - _ALL))))


def holm(p: Array) -> Array:
    """Probabilities adjusted for there being several, shape (n,); NaN are none and stay.

    Source: [Holm1979]; the step-down that holds whatever the dependence.
    """
    out = np.full(len(p), np.nan)
    known = np.flatnonzero(np.isfinite(p))
    order = known[np.argsort(p[known], kind="stable")]
    out[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(order), 0, -1)), 1.0)
    return out
