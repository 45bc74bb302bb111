r"""Covariance of a robust estimate from its own estimating equations, `A^-1 M A^-1`.

With psi of each reading at the estimate, J_b the rows of reading b and P the rows of all that is known beforehand
(stated priors, plausible sizes), all whitened,

    A = sum_b c w_b J_b^T J_b + P^T P,      M = sum_b |psi_b|^2 / d / (1 - h_b) J_b^T J_b + P^T P,

c = sum psi' / sum w over the readings of a noise group, so that readings which do not count tell nothing, and h_b the
leverage of reading b in A: psi of readings that draw the estimate along is small for that reason ([MacKinnon1985]'s
HC2). What is known beforehand is as good as it says: it enters both sums with unit variance, so that where the readings
tell nothing the plausible size remains. After [Huber1981] sec. 7.6; c by weights instead of over all readings is ours.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.fit.robust import Loss, loss_slopes, loss_weights
from symcal.fit.whitened import Whitened
from symcal.solvers.appended import appended

Array = NDArray[np.float64]

_LEAST = 1e-9  # share of a reading that must be left over by the others: below, its psi is rounding


def sandwich(system: Whitened, x: Array, spread: Array, factors: Mapping[str, float], loss: Loss) -> Array:
    """Covariance of y, shape (n, n), at the estimate x, the variances as they are.

    Args:
        spread: noise of every component, without robust weights, shape (N, m); infinite where nothing was measured.
        factors: on the plausible sizes, by group.
    """
    counts = np.isfinite(spread)
    inverse = counts / np.where(counts, spread, 1.0)
    white = system.rows.residual(x) * inverse
    steep, psi = np.zeros_like(white), np.zeros_like(white)
    for group in system.rows.measurement.groups:
        columns = list(group.columns)
        shape = (len(white), -1, group.block)
        norms = np.linalg.norm(white[:, columns].reshape(shape), axis=2)
        size = counts[:, columns].reshape(shape).sum(axis=2)
        w, slope = loss_weights(loss, norms, group.block), loss_slopes(loss, norms, group.block)
        share = max(float(slope[size > 0].sum()), 0.0) / max(float(w[size > 0].sum()), _LEAST)
        steep[:, columns] = np.repeat(np.sqrt(share * w), group.block, axis=1)
        psi[:, columns] = np.repeat(w * norms / np.sqrt(np.maximum(size, 1)), group.block, axis=1)
    known, n = system.known_rows(x, factors)[:, :-1], len(system.free)

    def pieces() -> Iterator[tuple[slice, Array]]:
        for own, part in system.rows.pieces():
            jacobian = part(x)[1][:, :, system.index]
            yield own, (jacobian * system.scales * inverse[own, :, None])[counts[own]]

    held = None if system.rows.many else list(pieces())
    triangle = np.zeros((0, n))
    for own, rows in held or pieces():
        triangle = appended(triangle, rows * steep[own][counts[own]][:, None])
    root = scipy.linalg.solve_triangular(appended(triangle, known), np.eye(n))
    blocks = _blocks(system)
    scattered = np.zeros((0, n))
    for own, rows in held or pieces():
        kept = counts[own]
        telling = np.zeros(kept.shape)
        telling[kept] = np.sum((rows * steep[own][kept][:, None] @ root) ** 2, axis=1)
        leverage = np.stack([telling[:, of].sum(axis=1) for of in blocks], axis=1)
        size = np.stack([kept[:, of].sum(axis=1) for of in blocks], axis=1)
        each = np.zeros(kept.shape)
        for i, of in enumerate(blocks):
            each[:, of] = (leverage[:, i] / np.maximum(size[:, i], 1))[:, None]
        left = np.sqrt(np.maximum(1 - each[kept], _LEAST))
        scattered = appended(scattered, rows * (psi[own][kept] / left)[:, None] @ root)
    half = root @ appended(scattered, known @ root).T
    return np.asarray(half @ half.T)


def _blocks(system: Whitened) -> list[list[int]]:
    """Components of every reading of a pose."""
    return [
        list(group.columns[first : first + group.block])
        for group in system.rows.measurement.groups
        for first in range(0, len(group.columns), group.block)
    ]
