"""Covariance of an identification, and the error that it lets one expect.

On the identifiable subspace C = S V_1 diag(1 / s^2) V_1^T S, with W = Sigma^-1/2 J S = U diag(s) V^T; this is the
Cramer-Rao bound for normal noise. The unseen directions are held at nominal: their variance is not zero but unknown,
so parameters that they touch get no sigma.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from symcal.identification.identifiability import Identifiability

Array = NDArray[np.float64]


def covariance(seen: Identifiability) -> Array:
    """Covariance of the free parameters on the identifiable subspace, shape (n, n), in mm and rad."""
    root = seen.scales[:, None] * seen.seen / seen.seen_values
    return root @ root.T


def sigmas(seen: Identifiability) -> list[float | None]:
    """Standard deviation of each free parameter; None where what the gauge leaves open exceeds it.

    The hidden directions leave a parameter open by its scale times its share of the hidden subspace.
    """
    sigma = np.sqrt(np.diag(covariance(seen)))
    leak = seen.scales * np.linalg.norm(seen.hidden, axis=1)
    return [
        None if gap > max(value, 1e-9 * scale) else float(value)
        for gap, value, scale in zip(leak, sigma, seen.scales, strict=True)
    ]


def correlation(seen: Identifiability) -> Array:
    """Correlation matrix of the free parameters on the identifiable subspace, shape (n, n); zero for unseen ones."""
    c = covariance(seen)
    touched = np.linalg.norm(seen.seen, axis=1) > 1e-9  # not just by rounding
    inverse = np.where(touched, 1 / np.sqrt(np.where(touched, np.diag(c), 1.0)), 0.0)
    return np.asarray(c * np.outer(inverse, inverse))


def predicted_rms(jacobian: Array, cov: Array) -> Array:
    """Expected rms error at each pose, sqrt(tr(J C J^T)), shape (N,).

    Args:
        jacobian: dh/dx of what is asked about, shape (N, k, n), mm (or rad) per unit. cov: shape (n, n).
    """
    variance = np.einsum("pki,ij,pkj->p", jacobian, cov, jacobian, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def sigma_interval(sigma: float, dof: int, confidence: float = 0.95) -> tuple[float, float]:
    """Confidence interval of a noise sigma estimated with ``dof`` degrees of freedom (chi-squared)."""
    tail = (1 - confidence) / 2
    return (
        float(sigma * np.sqrt(dof / stats.chi2.ppf(1 - tail, dof))),
        float(sigma * np.sqrt(dof / stats.chi2.ppf(tail, dof))),
    )
