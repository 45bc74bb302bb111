"""The rows of a fit as `symcal.fit.difference` wants them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal.fit.difference import HalfRows
from symcal.fit.estimation import Fit
from symcal.fit.pose_rows import PoseRows, pose_rows
from symcal.fit.robust import loss_slopes
from symcal.fit.variances import VarianceModel

Array = NDArray[np.float64]

_LEAST = 1e-9  # of what counts: so little is rounding


def half_rows(system: VarianceModel, after: Fit) -> HalfRows:
    """The rows of a fit at its estimate, its variances as they are."""
    whole = system.system
    own = pose_rows(whole.rows, after.x, system.spread(after.variances))
    known = whole.known_rows(after.x, after.every_factor)
    slopes = own.jacobian[:, whole.index] * whole.scales
    groups = whole.rows.measurement.groups
    dof = [max(after.by_group[g.name][1], _LEAST) if g.name in after.estimated else np.inf for g in groups]
    bread, meat = [1.0] * len(groups), [1.0] * len(groups)
    if after.loss != "linear":
        bread, meat = _of_loss(system, after, own, slopes, known[:, :-1])
    return HalfRows(slopes, own.r, own.pose, own.group, known, dof, bread, meat)


def _of_loss(
    system: VarianceModel, after: Fit, own: PoseRows, slopes: Array, known: Array
) -> tuple[list[float], list[float]]:
    """c = sum psi' / sum w of every noise group, and m = sum |psi|^2 / (sum w - what the parameters have taken)."""
    rows = system.system.rows
    plain = system.spread(replace(after.variances, weights=rows.seen.astype(float)))
    white = np.where(np.isfinite(plain), rows.residual(after.x) / plain, 0.0)
    bread, psi, weight = [], [], []
    for group in rows.measurement.groups:
        columns = list(group.columns)
        size = rows.seen[:, columns].reshape(len(white), -1, group.block).sum(axis=2)
        norms = np.linalg.norm(white[:, columns].reshape(len(white), -1, group.block), axis=2)
        w = after.weights[:, columns].reshape(len(white), -1, group.block).max(axis=2)
        slope = loss_slopes(after.loss, norms, group.block)
        total = max(float(w[size > 0].sum()), _LEAST)
        bread.append(max(float(slope[size > 0].sum()) / total, _LEAST))
        psi.append(float(np.sum((w * norms) ** 2)))
        weight.append(float(np.sum(w * size)))
    steep = slopes * np.sqrt(np.asarray(bread))[own.group][:, None]
    triangle: Array = np.asarray(np.linalg.qr(np.vstack([steep, known]), mode="r"), dtype=np.float64)
    taken = np.sum(np.linalg.solve(triangle.T, steep.T) ** 2, axis=0)
    by_group = np.bincount(own.group, taken, minlength=len(bread))
    left = np.maximum(np.asarray(weight) - by_group, _LEAST)
    return bread, list(np.asarray(psi) / left)
