"""Noise of the data: known sigmas, variance components estimated from the residuals, robust weights.

Unknown sigmas are variance components, one per group: sigma_g^2 = |r_g|^2 / (m_g - tr H_gg), iterated to a fixed point
([Koch1999] sec. 3.6). With a robust loss they come from the median of the block norms instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from symcal.identification.identifiability import Identifiability
from symcal.identification.rows import Rows
from symcal.measurements import Group

Array = NDArray[np.float64]
Loss = Literal["linear", "huber", "cauchy"]

SIGMA_FLOOR = {"position": 1e-9, "orientation": 1e-12, "image": 1e-9}
"""Noise of data that have none (simulations): rounding, in mm, rad, px."""

_HUBER_QUANTILE = 0.95  # of the block norm's chi distribution: where a residual starts to count less


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


def spread_of(rows: Rows, known: Array, sigmas: Mapping[str, float], weights: Array) -> Array:
    """Standard deviation used for whitening, shape (N, m).

    Infinite where nothing was measured or a robust weight is zero.
    """
    groups = rows.measurement.per_component({g.name: sigmas.get(g.name, np.nan) for g in rows.measurement.groups})
    sigma = np.where(np.isfinite(known), known, groups)
    with np.errstate(divide="ignore"):
        return np.where(rows.seen & (weights > 0), sigma / np.sqrt(weights), np.inf)


def variance_components(
    rows: Rows,
    residual: Array,
    jacobian: Array,
    known: Array,
    spread: Array,
    seen: Identifiability,
    estimated: tuple[str, ...],
) -> dict[str, float]:
    """One step of the fixed point; components whose sigma is known count in the fit but not here."""
    index = rows.measurement.parameters.indices(seen.names)
    white = jacobian[:, :, index] * seen.scales / spread[:, :, None]
    u = white @ (seen.seen / seen.seen_values)
    leverage = np.sum(u**2, axis=2)
    out: dict[str, float] = {}
    for group in rows.measurement.groups:
        if group.name in estimated:
            columns = list(group.columns)
            mask = rows.seen[:, columns] & np.isnan(known[:, columns])
            redundancy = max(float(np.sum((1 - leverage[:, columns])[mask])), 1e-3)
            variance = float(np.sum(residual[:, columns][mask] ** 2)) / redundancy
            out[group.name] = max(float(np.sqrt(variance)), SIGMA_FLOOR[group.name])
    return out


def _blocks(group: Group, values: NDArray[Any]) -> NDArray[Any]:
    """The components of a group by observation, shape (N, k, block)."""
    return values[:, list(group.columns)].reshape(len(values), -1, group.block)


def block_sigmas(rows: Rows, residual: Array, known: Array, estimated: tuple[str, ...], rank: int) -> dict[str, float]:
    """Robust sigma per group: the median, over observations, of norm / sqrt(median of chi-squared)."""
    out: dict[str, float] = {}
    equations = int(rows.seen.sum())
    for group in rows.measurement.groups:
        if group.name in estimated:
            unknown = _blocks(group, rows.seen & np.isnan(known))
            size = unknown.sum(axis=2)
            norms = np.linalg.norm(np.where(unknown, _blocks(group, residual), 0.0), axis=2)[size > 0]
            expected = np.sqrt(stats.chi2.median(size[size > 0]) * max(equations - rank, 1) / equations)
            out[group.name] = max(float(np.median(norms / expected)), SIGMA_FLOOR[group.name])
    return out


def robust_weights(rows: Rows, residual: Array, known: Array, sigmas: Mapping[str, float], loss: Loss) -> Array:
    """Weights of iteratively reweighted least squares, one per block, spread over its components."""
    spread = spread_of(rows, known, sigmas, np.ones_like(residual))
    white = np.where(np.isfinite(spread), residual / spread, 0.0)
    weights = rows.seen.astype(float)
    for group in rows.measurement.groups:
        norms = np.linalg.norm(_blocks(group, white), axis=2)
        t = norms / np.sqrt(stats.chi2.ppf(_HUBER_QUANTILE, group.block))
        w = 1 / np.maximum(t, 1.0) if loss == "huber" else 1 / (1 + t**2)
        weights[:, list(group.columns)] *= np.repeat(w, group.block, axis=1)
    return weights
