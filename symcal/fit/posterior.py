"""What is known after a fit: covariance, the share learnt from the data, Student t intervals, predictions.

The posterior covariance of the parameters x = x_ref + S y at given variances is S A^-1 S; the uncertainty of the
variances themselves adds S (dy/dphi) V (dy/dphi)^T S, V = 2 F^-1 ([Kass1989] sec. 3). What the data do not tell keeps
its plausible size as its standard deviation. Degrees of freedom of a variance v are 2 v^2 / (g^T V g), g = dv/dphi
([Satterthwaite1946]), so an interval widens where noise or plausible size are known badly.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.fit.variance_components import Block, Components

Array = NDArray[np.float64]

MOST_DOF = 1e6
"""Degrees of freedom from which on Student's t is the normal law."""
FEWEST = 2.5
"""Degrees of freedom with which an rms is foretold where there are fewer."""
_FEWEST_DOF = 1.0


@dataclass(frozen=True, slots=True)
class Posterior:
    """Normal posterior of the free parameters (mm, rad, px), with Student t tails.

    names: of the n free parameters. covariance: shape (n, n). assumed: standard deviation before the data, shape (n,).
    learnt: share of each parameter that came from the data, 0 to 1: one minus the ratio of its variances after and
        before.
    slopes: derivatives of the covariance by the log variances, shape (b, n, n); uncertainty: of those, V, shape (b, b).
    """

    names: tuple[str, ...]
    covariance: Array
    assumed: Array
    learnt: Array
    slopes: Array = field(repr=False)
    uncertainty: Array = field(repr=False)

    @property
    def sigmas(self) -> Array:
        """Standard deviation of each parameter, shape (n,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def dof(self) -> Array:
        """Degrees of freedom of each parameter's Student t, shape (n,)."""
        return self._dof(np.diag(self.covariance), np.diagonal(self.slopes, axis1=1, axis2=2))

    def half_widths(self, confidence: float = 0.95) -> Array:
        """Half the length of the central interval of each parameter, shape (n,)."""
        return self._half(self.sigmas, self.dof, confidence)

    def correlation(self) -> Array:
        """Correlation matrix of the free parameters, shape (n, n)."""
        sigma = self.sigmas
        return np.asarray(self.covariance / np.outer(sigma, sigma))

    def prediction_half_widths(self, jacobian: Array, confidence: float = 0.95) -> Array:
        """Half the length of the central interval of predictions h(x) without noise, shape (...,).

        Args:
            jacobian: dh/dx by the free parameters, shape (..., n).
        """
        variance = np.einsum("...i,ij,...j->...", jacobian, self.covariance, jacobian, optimize=True)
        slopes = np.einsum("...i,bij,...j->b...", jacobian, self.slopes, jacobian, optimize=True)
        return self._half(np.sqrt(np.maximum(variance, 0.0)), self._dof(variance, slopes), confidence)

    def predicted_rms(self, jacobian: Array) -> Array:
        """Expected rms error at each pose, shape (N,); without the noise of a measurement.

        sqrt(tr(J C J^T) nu / (nu - 2)), the second factor because Student's t has longer tails than the normal law: it
        tells where noise or sizes are known badly. With two degrees of freedom or fewer it would be infinite, and is
        taken at ``FEWEST`` instead.

        Args:
            jacobian: dh/dx of what is asked about, shape (N, k, n), mm (or rad) per unit.
        """
        variance = predicted_rms(jacobian, self.covariance) ** 2
        slopes = np.einsum("pki,bij,pkj->bp", jacobian, self.slopes, jacobian, optimize=True)
        dof = np.maximum(self._dof(variance, slopes), FEWEST)
        return np.asarray(np.sqrt(variance * dof / (dof - 2)))

    def _dof(self, variance: Array, slopes: Array) -> Array:
        spread = np.einsum("b...,bc,c...->...", slopes, self.uncertainty, slopes, optimize=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            dof = np.where(spread > 0, 2 * variance**2 / spread, MOST_DOF)
        return np.clip(dof, _FEWEST_DOF, MOST_DOF)

    def _half(self, sigma: Array, dof: Array, confidence: float) -> Array:
        return np.asarray(sigma * scipy.special.stdtrit(dof, 0.5 + confidence / 2))


def predicted_rms(jacobian: Array, covariance: Array) -> Array:
    """sqrt(tr(J C J^T)) at each pose, shape (N,), for Jacobians (N, k, n) and a covariance (n, n)."""
    variance = np.einsum("pki,ij,pkj->p", jacobian, covariance, jacobian, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def posterior_of(
    names: tuple[str, ...],
    scales: Array,
    found: Components,
    blocks: tuple[Block, ...],
    assumed: Array,
    covariance: Array | None = None,
) -> Posterior:
    """The posterior of x = x_ref + S y.

    Args:
        scales: diagonal of S, shape (n,). found: of y, at the most likely variances. assumed: standard deviations of x
            before the data, shape (n,). covariance: of y at given variances, where it is not A^-1: that of a robust
            estimate (`symcal.fit.sandwich`).
    """
    n = len(names)
    uncertainty, open_ = np.zeros_like(found.fisher), np.flatnonzero(~found.held)
    uncertainty[np.ix_(open_, open_)] = 2 * np.linalg.pinv(found.fisher[np.ix_(open_, open_)], hermitian=True)
    inner = found.covariance if covariance is None else covariance
    halves = [
        found.root @ (np.exp(-0.5 * p) * block.rows[:, :n] @ found.root).T
        for block, p in zip(blocks, found.phi, strict=True)
    ]
    slopes = np.array([half @ half.T for half in halves]).reshape(len(blocks), n, n)
    outer = np.outer(scales, scales)
    added = found.moves.T @ uncertainty @ found.moves
    variance = scales**2 * np.diag(inner)
    with np.errstate(invalid="ignore"):
        learnt = np.clip(1 - variance / assumed**2, 0.0, 1.0)
    return Posterior(names, outer * (inner + added), assumed, learnt, outer * slopes, uncertainty)
