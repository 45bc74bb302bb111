"""The rows of a fit as `symcal.fit.difference` wants them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal.fit.difference import HalfRows
from symcal.fit.pose_rows import PoseRows, pose_rows
from symcal.fit.robust import loss_slopes
from symcal.fit.variances import VarianceModel, Variances

Array = NDArray[np.float64]

_LEAST = 1e-9  # of what counts: so little is rounding


def half_rows(system: VarianceModel, x: Array, variances: Variances, estimated: Collection[str]) -> HalfRows:
    """The rows of a fit at its estimate x, its variances as they are.

    Args:
        estimated: noise groups whose noise these rows have told.
    """
    whole = system.system
    own = pose_rows(whole.rows, x, system.spread(variances))
    known = whole.known_rows(x, variances.factors)
    slopes = own.jacobian[:, whole.index] * whole.scales
    groups = whole.rows.measurement.groups
    weights = [float(variances.weights[:, list(g.columns)][whole.rows.seen[:, list(g.columns)]].sum()) for g in groups]
    bread, psi = [1.0] * len(groups), weights
    if system.loss != "linear":
        bread, psi = _of_loss(system, x, variances)
    left = np.maximum(np.asarray(weights) - _taken(own, slopes, known[:, :-1], bread), _LEAST)
    meat = [1.0] * len(groups) if system.loss == "linear" else list(np.asarray(psi) / left)
    dof = [float(free) if g.name in estimated else np.inf for g, free in zip(groups, left, strict=True)]
    return HalfRows(slopes, own.r, own.pose, own.group, known, dof, bread, meat)


def _taken(own: PoseRows, slopes: Array, known: Array, bread: list[float]) -> Array:
    """How many of the equations of every noise group the parameters have taken."""
    steep = slopes * np.sqrt(np.asarray(bread))[own.group][:, None]
    triangle: Array = np.asarray(np.linalg.qr(np.vstack([steep, known]), mode="r"), dtype=np.float64)
    taken = np.sum(np.linalg.solve(triangle.T, steep.T) ** 2, axis=0)
    return np.asarray(np.bincount(own.group, taken, minlength=len(bread)))


def _of_loss(system: VarianceModel, x: Array, variances: Variances) -> tuple[list[float], list[float]]:
    """c = sum psi' / sum w and sum |psi|^2 of every noise group."""
    rows = system.system.rows
    plain = system.spread(replace(variances, weights=rows.seen.astype(float)))
    white = np.where(np.isfinite(plain), rows.residual(x) / plain, 0.0)
    bread, psi = [], []
    for group in rows.measurement.groups:
        shape, columns = (len(white), -1, group.block), list(group.columns)
        read = rows.seen[:, columns].reshape(shape).any(axis=2)
        norms = np.linalg.norm(white[:, columns].reshape(shape), axis=2)
        w = variances.weights[:, columns].reshape(shape).max(axis=2)
        slope = loss_slopes(system.loss, norms, group.block)
        bread.append(max(float(slope[read].sum()) / max(float(w[read].sum()), _LEAST), _LEAST))
        psi.append(float(np.sum((w * norms) ** 2)))
    return bread, psi
