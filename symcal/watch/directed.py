r"""Directed tests: whether the readings of a check changed as one thing that may happen would make them change.

With residuals r = h(q, x) - z at the recorded estimate x, noise Sigma, and x off the truth by errors of covariance C,

    cov(r) = V = Sigma + J C J^T,      W V W^T = 1,      r* = W r,      D* = W D,

r* is white if nothing changed, and moves along the columns of D* if what D stands for did. Of each D*, without what
moved anyway (an instrument that was set up anew), the squared length of r* in its d directions is

    T = |Q^T r*|^2,      Q an orthonormal basis of D*,

chi^2_d where the noise is known, and T / d as Fisher's F of d and nu where it was estimated with nu degrees of freedom;
if D y happened, it is noncentral with lambda = y^T D*^T D* y. All that is in no direction that is asked about makes the
sum of squares less sure, and T not. Alarm is where one of m tests is beyond its share of alpha ([Dunn1961]; see
`symcal.watch.shares`). Of textbooks, but for V.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

POWER = 0.95
"""With which the smallest changes that are told of are found."""

_NESTED = 1e-5  # share of a column that is left: rounding, or the curve of a large motion


@dataclass(frozen=True, slots=True)
class Tested:
    """squares: T. directions: d. p: of a larger T by chance; 1 where there is no direction."""

    squares: float
    directions: int
    p: float


@dataclass(frozen=True, slots=True)
class Law:
    """What T is compared with. dof: nu, infinite where the noise is stated. level: of the test, its share of
    alpha."""

    dof: float
    level: float

    def tested(self, squares: float, directions: int) -> Tested:
        if directions == 0:
            return Tested(squares, 0, 1.0)
        if np.isinf(self.dof):
            return Tested(squares, directions, float(scipy.special.chdtrc(directions, squares)))
        return Tested(squares, directions, float(scipy.special.fdtrc(directions, self.dof, squares / directions)))

    def limit(self, directions: int) -> float:
        """T at which there is alarm."""
        if np.isinf(self.dof):
            return float(scipy.special.chdtri(directions, self.level))
        return float(directions * scipy.special.fdtri(directions, self.dof, 1 - self.level))

    def power(self, directions: int, size: float) -> float:
        """Probability of alarm at lambda = size."""
        limit = self.limit(directions)
        if np.isinf(self.dof):
            return float(1 - scipy.special.chndtr(limit, directions, size))
        return float(1 - scipy.special.ncfdtr(directions, self.dof, size, limit / directions))

    @staticmethod
    def reaching(dof: float, size: float, power: float) -> float:
        """Level at which lambda = size in one direction is found with a power."""
        if np.isinf(dof):
            return float(scipy.special.chdtrc(1, scipy.special.chndtrix(1 - power, 1, size)))
        return float(scipy.special.fdtrc(1, dof, scipy.special.ncfdtri(1, dof, size, 1 - power)))

    def needed(self, directions: int, power: float = POWER) -> float:
        """lambda with which T is above its limit so often."""
        return _needed(self, directions, power)

    def half_width(self, sigma: Array) -> Array:
        """Of central 95 % intervals of numbers of these standard deviations."""
        return np.asarray(scipy.special.stdtrit(min(self.dof, 1e9), 0.975) * sigma)


@lru_cache(maxsize=256)
def _needed(law: Law, directions: int, power: float) -> float:
    far = 10.0 + 4.0 * np.sqrt(law.limit(directions))
    return float(scipy.optimize.brentq(lambda root: law.power(directions, root**2) - power, 0.0, far)) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class White:
    """The readings of a check, whitened. r: r*, shape (k,). mixing: W, shape (k, k). pose: of every reading, (k,)."""

    r: Array
    mixing: Array
    pose: NDArray[np.intp]


def whitening(slopes: Array, root: Array, spread: Array) -> Array:
    """W, shape (k, k).

    Args:
        slopes: J, shape (k, n). root: L with L L^T = C, shape (n, l). spread: standard deviations of the noise, (k,).
    """
    known = (slopes / spread[:, None]) @ root
    inner = np.linalg.cholesky(np.eye(len(spread)) + known @ known.T)
    return np.asarray(scipy.linalg.solve_triangular(inner, np.diag(1 / spread), lower=True))


def added(given: Array, columns: Array) -> Array:
    """Orthonormal basis of what columns (k, d) add to those that an orthonormal basis (k, g) spans, shape (k, d')."""
    size = np.linalg.norm(columns, axis=0)
    unit = columns[:, size > 0] / size[size > 0]
    left, share, _ = np.linalg.svd(unit - given @ (given.T @ unit), full_matrices=False)
    return np.asarray(left[:, share > _NESTED])


def in_direction(r: Array, basis: Array, law: Law) -> Tested:
    """T of readings (k,) in the directions of an orthonormal basis (k, d)."""
    return law.tested(float(np.sum((basis.T @ r) ** 2)), basis.shape[1])


def left_over(r: Array, given: Array, law: Law) -> Tested:
    """The sum of squares of what an orthonormal basis (k, g) leaves."""
    return law.tested(max(float(r @ r - np.sum((given.T @ r) ** 2)), 0.0), len(r) - given.shape[1])


def information(given: Array, columns: Array) -> Array:
    """D*^T D* without what an orthonormal basis spans, shape (d, d)."""
    left = columns - given @ (given.T @ columns)
    return np.asarray(left.T @ left)
