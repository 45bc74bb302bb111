r"""Unknown variances of a linear model by restricted marginal likelihood (REML).

The rows of a model fall into blocks: the measurements of each noise group, and the plausible sizes of the parameters as
pseudo-measurements of zero. With T_i the rows [J r] of block i at unit variance, m_i of them, and variances exp(phi_i),

    -2 log L(phi) = sum_i m_i phi_i + log det A + rho^2 + sum_i 2 log(1 + phi_i^2 / w_i^2),
    A = sum_i exp(-phi_i) J_i^T J_i,    rho^2 = min_y sum_i exp(-phi_i) |J_i y + r_i|^2

up to a constant. Parameters with a flat prior (frames) are integrated out by the determinant; for those with a
plausible size this is their marginal likelihood, since a proper prior is the same thing as a pseudo-measurement
([Harville1977]). Every term has exact derivatives,

    d/d phi_i = m_i - tr H_ii - |rho_i|^2 + 4 phi_i / (w_i^2 + phi_i^2),
    F_ij = (m_i - 2 tr H_ii) delta_ij + tr H_ij H_ji,

H = T A^-1 T^T the projection and F / 2 the Fisher information of phi: the maximum is found by Fisher scoring with a
line search on L itself. The last term, ours, is a Cauchy law of half width w about zero for a variance that is thought
to be one unless the data clearly say otherwise; it is left out for others. A `Tie` is the same for a difference.

Source: [Patterson1971], [Harville1977] for REML; [Kass1989] for what the uncertainty of phi adds to that of y.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.solvers.appended import appended

Array = NDArray[np.float64]

_STEPS = 60
_LONGEST = 2.0  # largest change of a log variance in one step
_ARMIJO = 1e-4
_RIDGE = 1e-9  # of the number of rows: a variance that the data say nothing about stays where it is


@dataclass(frozen=True, slots=True)
class Block:
    """Rows that share one unknown variance.

    rows: [J r] at unit variance, compressed to a triangle, shape (k, n + 1). count: how many rows they stand for.
    lowest, highest: limits of the log variance. width: w, half width of the log variance's Cauchy law about zero;
    infinite without one.
    """

    rows: Array
    count: int
    lowest: float
    highest: float
    width: float = np.inf


@dataclass(frozen=True, slots=True)
class Tie:
    """Two log variances that are thought to differ by ``gap``: a Cauchy law of half width ``width`` about that."""

    first: int
    second: int
    gap: float
    width: float

    def off(self, phi: Array) -> float:
        return float(phi[self.second] - phi[self.first]) - self.gap


@dataclass(frozen=True, slots=True)
class Components:
    """The model at given log variances.

    phi: shape (b,). value: -2 log L. slope, fisher: its gradient (b,) and F (b, b). y: the minimiser, shape (n,).
    root: R^-1 with A^-1 = R^-1 R^-T, shape (n, n). moves: dy / dphi, shape (b, n). held: which variances a limit holds.
    """

    phi: Array
    value: float
    slope: Array
    fisher: Array
    y: Array
    root: Array
    moves: Array
    held: NDArray[np.bool_]

    @property
    def covariance(self) -> Array:
        """A^-1, shape (n, n)."""
        return self.root @ self.root.T


def compressed(rows: Array) -> Array:
    """The triangle of rows [J r], shape (k, n + 1): the same squared norms from at most n + 1 rows."""
    return appended(np.zeros((0, rows.shape[1])), rows) if len(rows) > rows.shape[1] else rows


def at_variances(blocks: Sequence[Block], known: Array, phi: Array, ties: Sequence[Tie] = ()) -> Components:
    """The model at log variances ``phi``.

    Args:
        known: [J r] of the rows whose variance is known, whitened, shape (k, n + 1).
    """
    n = int(known.shape[1]) - 1
    scaled = [block.rows * np.exp(-0.5 * value) for block, value in zip(blocks, phi, strict=True)]
    triangle = appended(np.zeros((0, n + 1)), np.concatenate([*scaled, known]))
    upper, right = triangle[:n, :n], triangle[:n, n]
    # its LU decomposition is itself: this is back substitution
    root: Array = np.asarray(np.linalg.inv(upper), dtype=np.float64)
    y = -root @ right
    widths, counts = np.array([block.width for block in blocks]), np.array([block.count for block in blocks])
    projected = [rows[:, :n] @ root for rows in scaled]
    left = [rows @ np.append(y, 1.0) for rows in scaled]
    grams = np.array([(p.T @ p).ravel() for p in projected]).reshape(len(blocks), n * n)
    traces = grams[:, :: n + 1].sum(axis=1)
    prior = 4.0 / (widths**2 + phi**2)
    fisher = grams @ grams.T
    fisher[np.diag_indices(len(blocks))] += counts - 2 * traces + prior
    slope = counts - traces - np.array([v @ v for v in left]) + prior * phi
    tied = 0.0
    for tie in ties:
        off, pair = tie.off(phi), [tie.first, tie.second]
        pull = 4.0 / (tie.width**2 + off**2)
        tied += 2 * np.log1p((off / tie.width) ** 2)
        slope[pair] += pull * off * np.array([-1.0, 1.0])
        fisher[np.ix_(pair, pair)] += pull * np.array([[1.0, -1.0], [-1.0, 1.0]])
    low, high = np.array([block.lowest for block in blocks]), np.array([block.highest for block in blocks])
    return Components(
        phi=phi,
        value=float(
            counts @ phi
            + 2 * np.log(np.abs(np.diag(upper))).sum()
            + triangle[n, n] ** 2
            + 2 * np.log1p((phi / widths) ** 2).sum()
            + tied
        ),
        slope=slope,
        fisher=fisher,
        y=y,
        root=root,
        moves=np.array([root @ (p.T @ v) for p, v in zip(projected, left, strict=True)]).reshape(len(blocks), n),
        held=((phi <= low) & (slope > 0)) | ((phi >= high) & (slope < 0)),
    )


def most_likely(
    blocks: Sequence[Block], known: Array, start: Array, ties: Sequence[Tie] = (), *, tolerance: float
) -> Components:
    """The model at the log variances of `likeliest`."""
    return at_variances(blocks, known, likeliest(blocks, known, start, ties, tolerance=tolerance), ties)


def likeliest(
    blocks: Sequence[Block], known: Array, start: Array, ties: Sequence[Tie] = (), *, tolerance: float
) -> Array:
    """The log variances of largest marginal likelihood, shape (b,), from one start by Fisher scoring.

    Args:
        tolerance: change of a log variance that ends the search.
    """
    low, high = np.array([b.lowest for b in blocks]), np.array([b.highest for b in blocks])
    phi = np.clip(start, low, high)
    if not blocks:
        return phi
    floor = _RIDGE * np.array([max(b.count, 1) for b in blocks])
    now = at_variances(blocks, known, phi, ties)
    for _ in range(_STEPS):
        free = np.flatnonzero(~now.held)
        step = np.zeros_like(now.phi)
        curvature = now.fisher[np.ix_(free, free)] + np.diag(floor[free])
        step[free] = -np.linalg.solve(curvature, now.slope[free])
        step /= max(float(np.abs(step).max(initial=0.0)) / _LONGEST, 1.0)
        length = 1.0
        while True:
            trial = np.clip(now.phi + length * step, low, high)
            moved = trial - now.phi
            if np.abs(moved).max() <= tolerance:
                return trial if length == 1 else now.phi  # a whole step is as good as Fisher scoring gets
            there = at_variances(blocks, known, trial, ties)
            if there.value <= now.value + _ARMIJO * float(now.slope @ moved):
                break
            length /= 2
        now = there
    return now.phi
