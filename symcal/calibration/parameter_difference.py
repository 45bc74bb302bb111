r"""Whether two estimates of the same parameters differ by more than their joint uncertainty.

An estimate is a posterior mean x^ of covariance C under a prior of mean zero and sizes S, so that

    x^ = W m + noise,    W = I - C S^-2,    cov(noise) = V = C - C S^-2 C,

with m the truth: it is drawn towards zero where the data say little. Two independent estimates a and b of one truth
differ by d = x^_b - x^_a, with

    cov(d) = V_a + V_b + (W_a - W_b) T^2 (W_a - W_b)^T.

The last term is there because the two are drawn differently where they know different things; T is the size of the
truth: the plausible size, or what was found where that is more than twice as large, so that a parameter far beyond its
plausible size (after a crash) raises no alarm by itself.

What both determine: M = C^-1 - S^-2 is what the data alone tell, and the parallel sum

    P = M_a (M_a + M_b)^-1 M_b

is the information on a difference. Directions of P above one, in units of the plausible sizes, are those in which a
difference of plausible size could be told; d is tested there and nowhere else. A gauge of either estimate has no
information and drops out. Where noise was estimated, squares are F distributed and single parameters Student's t, with
degrees of freedom after [Satterthwaite1946]. Names are given at a simultaneous level after [Holm1979].

All of it is ours, but for the two laws. Halves of one data set are compared from their rows, with the same covariance
(`symcal.fit.difference`); here posteriors are enough, and parameters are named.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.fit.difference import holm
from symcal.fit.posterior import MOST_DOF
from symcal.words import MOSTLY

Array = NDArray[np.float64]

LEVEL = 0.05
"""Share of pairs of equal robots of which some parameter is named."""

_DETERMINED = 1.0  # information on a difference, in units of the plausible size
_NO_INFORMATION = 1e-6  # in the same unit: rounding
_FAR = 2.0  # plausible sizes beyond which an estimate says more of the size of the truth
_SMALLEST = 1e-15  # share of the plausible variance that is left: rounding


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """An estimate of n parameters, all in their own units.

    mean: posterior mean, shape (n,). covariance: posterior, shape (n, n). sizes: standard deviations before the data,
    shape (n,); priors are independent and of mean zero. dof: degrees of freedom with which the noise is known.
    """

    mean: Array
    covariance: Array
    sizes: Array
    dof: float = math.inf


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """The second estimate minus the first.

    values: d, shape (n,). covariance: of d if the truth is the same, shape (n, n); `sigmas` are its roots.
    told: share of each parameter that lies in what both determine, 0 to 1, shape (n,).
    directions: how many both determine. statistic: squared length of d in them, in units of its covariance; about
        ``directions`` for equal robots. p: probability of one as large if the truth is the same; 1 without directions.
    each: the same of every parameter by itself, shape (n,), NaN where both do not mostly determine it. adjusted: after
        Holm over those that have one: below a level, the parameter differs at that simultaneous level.
    dof: of the F law of the statistic, at most `symcal.fit.posterior.MOST_DOF`.
    half_widths: of the central 95 % intervals of the single values, shape (n,).
    """

    values: Array
    covariance: Array
    told: Array
    directions: int
    statistic: float
    p: float
    each: Array
    adjusted: Array
    dof: float
    half_widths: Array

    @property
    def sigmas(self) -> Array:
        """Standard deviation of each difference if the truth is the same, shape (n,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def differing(self, level: float = LEVEL) -> NDArray[np.intp]:
        """Which parameters differ at a simultaneous level, the surest first."""
        named = np.flatnonzero(np.nan_to_num(self.adjusted, nan=1.0) < level)
        return named[np.argsort(self.each[named], kind="stable")]


def difference(a: Estimate, b: Estimate, blind: Array | None = None) -> Difference:
    """How b differs from a, and whether by more than two independent estimates of one truth do.

    Args:
        blind: a direction w such that w . x is known to neither from data, shape (n,): it is left out.
    """
    scale = np.sqrt(a.sizes * b.sizes)
    (noise_a, drawn_a, told_a), (noise_b, drawn_b, told_b) = (_parts(of, scale) for of in (a, b))
    values = (b.mean - a.mean) / scale
    plausible, found = np.maximum(a.sizes, b.sizes), np.maximum(np.abs(a.mean), np.abs(b.mean))
    size = np.where(found > _FAR * plausible, found, plausible) / scale
    pull = (drawn_b - drawn_a) * size
    covariance = noise_a + noise_b + pull @ pull.T
    basis = _determined(told_a, told_b, None if blind is None else blind * scale)
    told = np.sum(basis**2, axis=1)
    k = basis.shape[1]
    statistic, dof, p = 0.0, MOST_DOF, 1.0
    if k:
        inner: Array = np.linalg.cholesky(basis.T @ covariance @ basis).astype(np.float64)
        statistic = float(np.sum(np.linalg.solve(inner, basis.T @ values) ** 2))
        shares = [np.sum(_half(inner, basis, part)) / k for part in (noise_a, noise_b)]
        dof = float(_satterthwaite(shares[0], shares[1], a.dof, b.dof))
        p = float(scipy.special.fdtrc(k, dof, statistic / k))
    variance = np.diag(covariance)
    with np.errstate(invalid="ignore", divide="ignore"):
        parts = [np.nan_to_num(np.diag(part) / variance) for part in (noise_a, noise_b)]
        own_dof = _satterthwaite(parts[0], parts[1], a.dof, b.dof)
        each = 2 * scipy.special.stdtr(own_dof, -np.abs(values) / np.sqrt(variance))
    each = np.where((told >= MOSTLY) & (variance > 0), each, np.nan)
    return Difference(
        values=values * scale,
        covariance=covariance * np.outer(scale, scale),
        told=told,
        directions=k,
        statistic=statistic,
        p=p,
        each=each,
        adjusted=holm(each),
        dof=dof,
        half_widths=np.asarray(scipy.special.stdtrit(own_dof, 0.975) * np.sqrt(variance) * scale),
    )


def _parts(of: Estimate, scale: Array) -> tuple[Array, Array, Array]:
    """V, W and M of an estimate, (n, n) each, in units of ``scale``.

    Through the eigenvalues g of C in units of its own sizes, in (0, 1]: V has g (1 - g), W has 1 - g, M has 1/g - 1.
    """
    share, vectors = np.linalg.eigh(of.covariance / np.outer(of.sizes, of.sizes))
    share = np.clip(share, _SMALLEST, 1.0)
    own = of.sizes / scale
    noise = own[:, None] * (vectors * (share * (1 - share))) @ vectors.T * own
    drawn = own[:, None] * (vectors * (1 - share)) @ vectors.T / own
    told = (vectors * (1 / share - 1)) @ vectors.T / np.outer(own, own)
    return noise, drawn, told


def _determined(first: Array, second: Array, blind: Array | None) -> Array:
    """Directions in which both tell a difference of plausible size, orthonormal columns (n, k)."""
    total, vectors = np.linalg.eigh(first + second)
    kept = total > _NO_INFORMATION
    root = vectors[:, kept] * np.sqrt(total[kept])
    back = vectors[:, kept] / np.sqrt(total[kept])
    share, inner = np.linalg.eigh(back.T @ first @ back)
    share = np.clip(share, 0.0, 1.0)
    half = root @ (inner * np.sqrt(share * (1 - share)))  # P = half half^T
    out = np.eye(len(first))
    if blind is not None and blind.any():
        out = np.linalg.svd(blind[None])[2][1:].T
    left, size, _ = np.linalg.svd(out.T @ half, full_matrices=False)
    return np.asarray(out @ left[:, size**2 > _DETERMINED])


def _half(inner: Array, basis: Array, part: Array) -> Array:
    """Shares of a part of the covariance in directions whitened by all of it, shape (k,)."""
    white = np.linalg.solve(inner, basis.T @ part @ basis)
    return np.diag(np.linalg.solve(inner, white.T))


def _satterthwaite(first: Array | float, second: Array | float, dof_a: float, dof_b: float) -> Array:
    """Degrees of freedom of a sum of two variances, by the share of each."""
    with np.errstate(divide="ignore"):
        return np.minimum(1 / (np.square(first) / dof_a + np.square(second) / dof_b), MOST_DOF)
