"""Noise of the data: known sigmas, robust sigmas from the median of the residuals, robust weights.

Unknown sigmas without a robust loss are variance components (`symcal.fit.variance_components`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.fit.residual_rows import Rows
from symcal.fit.robust import Loss, loss_weights, shrinkage
from symcal.model.measurement import Group

Array = NDArray[np.float64]


def known_sigma(rows: Rows, stated: Mapping[str, float]) -> Array:
    """Known standard deviation of every component, shape (N, m); NaN where the data must tell."""
    if rows.mixing is not None:
        return np.ones((len(rows.data), rows.measurement.rows))
    known = np.full((len(rows.data), rows.measurement.rows), np.nan)
    for group in rows.measurement.groups:
        known[:, list(group.columns)] = stated.get(group.name, np.nan)
    if rows.data.sigma is not None:
        known = np.where(np.isfinite(rows.data.sigma), rows.data.sigma, known)
    return known


def unknown_noise(rows: Rows, known: Array) -> tuple[str, ...]:
    """The groups of which some measured component has no known sigma (see `known_sigma`)."""
    missing = np.isnan(known) & rows.seen
    return tuple(g.name for g in rows.measurement.groups if missing[:, list(g.columns)].any())


def spread_of(rows: Rows, known: Array, sigmas: Mapping[str, float], weights: Array) -> Array:
    """Standard deviation used for whitening, shape (N, m).

    Infinite where nothing was measured or a robust weight is zero, NaN where no sigma is given.
    """
    groups = rows.measurement.per_component({g.name: sigmas.get(g.name, np.nan) for g in rows.measurement.groups})
    sigma = np.where(np.isfinite(known), known, groups)
    with np.errstate(divide="ignore"):
        return np.where(rows.seen & (weights > 0), sigma / np.sqrt(weights), np.inf)


def _blocks(group: Group, values: NDArray[Any]) -> NDArray[Any]:
    """The components of a group by observation, shape (N, k, block)."""
    return values[:, list(group.columns)].reshape(len(values), -1, group.block)


def block_sigmas(
    rows: Rows, residual: Array, missing: NDArray[np.bool_], taken: Mapping[str, float]
) -> dict[str, float]:
    """Robust sigma per group: the median, over observations, of norm / sqrt(median of chi-squared).

    Args:
        missing: components whose noise is not known, shape (N, m). taken: by group, how many of their equations the
            parameters have taken: that makes residuals smaller than the noise.
    """
    out: dict[str, float] = {}
    for group in rows.measurement.groups:
        if group.name in taken:
            unknown = _blocks(group, missing)
            size = unknown.sum(axis=2)
            norms = np.linalg.norm(np.where(unknown, _blocks(group, residual), 0.0), axis=2)[size > 0]
            count = int(unknown.sum())
            expected = np.sqrt(
                2 * scipy.special.gammaincinv(size[size > 0] / 2, 0.5) * max(count - taken[group.name], 1) / count
            )
            out[group.name] = max(float(np.median(norms / expected)), group.floor)
    return out


def weighted_sigmas(
    rows: Rows, residual: Array, missing: NDArray[np.bool_], weights: Array, taken: Mapping[str, float], loss: Loss
) -> dict[str, float]:
    """Sigma per group from the readings that count: the weighted mean square, consistent at the normal law.

    What is left out is left out of both sums, so that gross errors do not make it larger.

    Args:
        missing: components whose noise is not known, shape (N, m). weights: robust ones, shape (N, m). taken: by group,
            how many of its weighted equations the parameters have taken.
    """
    out: dict[str, float] = {}
    for group in rows.measurement.groups:
        if group.name in taken:
            own = np.where(missing, weights, 0.0)[:, list(group.columns)]
            square = float(np.sum(own * residual[:, list(group.columns)] ** 2))
            left = max(float(own.sum()) - taken[group.name], 1.0) * shrinkage(loss, group.block)
            out[group.name] = max(float(np.sqrt(square / left)), group.floor)
    return out


def robust_weights(rows: Rows, residual: Array, known: Array, sigmas: Mapping[str, float], loss: Loss) -> Array:
    """Weights of iteratively reweighted least squares, one per block, spread over its components."""
    spread = spread_of(rows, known, sigmas, np.ones_like(residual))
    white = np.where(np.isfinite(spread), residual / spread, 0.0)
    weights = rows.seen.astype(float)
    for group in rows.measurement.groups:
        norms = np.linalg.norm(_blocks(group, white), axis=2)
        w = loss_weights(loss, norms, group.block)
        weights[:, list(group.columns)] *= np.repeat(w, group.block, axis=1)
    return weights
