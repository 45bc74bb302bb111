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

from collections.abc import Mapping

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.fit.robust import Loss, loss_slopes, loss_weights
from symcal.fit.whitened import Whitened

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
    r, jacobian = system.rows(x)
    steep, psi = np.zeros_like(r), np.zeros_like(r)
    blocks = np.zeros(r.shape, dtype=np.intp)
    for group in system.rows.measurement.groups:
        columns = list(group.columns)
        shape = (len(r), -1, group.block)
        norms = np.linalg.norm((r * inverse)[:, columns].reshape(shape), axis=2)
        size = counts[:, columns].reshape(shape).sum(axis=2)
        w, slope = loss_weights(loss, norms, group.block), loss_slopes(loss, norms, group.block)
        share = max(float(slope[size > 0].sum()), 0.0) / max(float(w[size > 0].sum()), _LEAST)
        steep[:, columns] = np.repeat(np.sqrt(share * w), group.block, axis=1)
        psi[:, columns] = np.repeat(w * norms / np.sqrt(np.maximum(size, 1)), group.block, axis=1)
        own = 1 + blocks.max() + np.arange(norms.size).reshape(norms.shape)
        blocks[:, columns] = np.repeat(own, group.block, axis=1)
    rows = (jacobian[:, :, system.index] * system.scales * inverse[:, :, None])[counts]
    known = system.known_rows(x, factors)[:, :-1]
    telling = rows * steep[counts][:, None]
    triangle: Array = np.asarray(np.linalg.qr(np.vstack([telling, known]), mode="r"), dtype=np.float64)
    root = scipy.linalg.solve_triangular(triangle, np.eye(triangle.shape[1]))
    own = blocks[counts]
    leverage = np.bincount(own, np.sum((telling @ root) ** 2, axis=1)) / np.maximum(np.bincount(own), 1)
    left = np.sqrt(np.maximum(1 - leverage[own], _LEAST))
    scattered = np.vstack([rows * (psi[counts] / left)[:, None], known]) @ root
    half = root @ np.asarray(np.linalg.qr(scattered, mode="r")).T
    return np.asarray(half @ half.T)
