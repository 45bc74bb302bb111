r"""Many identifications of one robot at once, for statistics that one draw cannot give.

Gauss-Newton on whitened, scaled rows, all repetitions in step:

    u <- V f(w) V^T W^T (W u - r / sigma),        W = J S / sigma,   W^T W = V diag(w) V^T,   x = S u

with f(w) = 1 / (1 + w), the plausible sizes of the parameters as their prior. Its fixed points are those of
`symcal.fit.estimation.fit` with known noise and sizes as stated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.model.model import Model

Array = NDArray[np.float64]

_TOGETHER = 250  # repetitions whose Jacobians are held at once
_CONVERGED = 1e-8  # largest change of a scaled error
_ITERATIONS = 50


@dataclass(frozen=True, slots=True)
class ManyFits:
    """x: errors, shape (R, n), mm and rad. ranks: directions seen, shape (R,). iterations: of the slowest."""

    x: Array
    ranks: NDArray[np.intp]
    iterations: int


def fit_many(model: Model, q: Array, z: Array, sigma: float) -> ManyFits:
    """Identify all parameters from R sets of positions with known noise.

    Args:
        q: joint readings, shape (N, dof), or another plan each time, (R, N, dof). z: positions, shape (R, N, 3), mm.
        sigma: noise per axis, mm.
    Raises:
        RefusedError: an identification does not converge.
    """
    parts = [
        _fit(model, np.broadcast_to(q, (len(z), *q.shape[-2:]))[i : i + _TOGETHER], z[i : i + _TOGETHER], sigma)
        for i in range(0, len(z), _TOGETHER)
    ]
    return ManyFits(
        np.concatenate([p.x for p in parts]),
        np.concatenate([p.ranks for p in parts]),
        max(p.iterations for p in parts),
    )


def _fit(model: Model, q: Array, z: Array, sigma: float) -> ManyFits:
    count, poses, dof = q.shape
    scales, setup = model.parameters.scales, model.setup.vector
    flat_q, flat_z = np.ascontiguousarray(q.reshape(-1, dof)), z.reshape(-1, z.shape[-1])
    u = np.zeros((count, len(scales)))
    for iteration in range(1, _ITERATIONS + 1):
        residual, jacobian = model.residual(flat_q, np.repeat(u * scales, poses, axis=0), setup, flat_z)
        rows = jacobian.reshape(count, -1, len(scales)) * (scales / sigma)
        implied = (rows @ u[:, :, None])[..., 0] - residual.reshape(count, -1) / sigma
        columns = rows.swapaxes(1, 2)
        values, vectors = np.linalg.eigh(columns @ rows)
        along = vectors.swapaxes(1, 2) @ (columns @ implied[:, :, None])
        moved = (vectors @ (along / (1.0 + values)[:, :, None]))[..., 0]
        change = float(np.max(np.abs(moved - u)))
        u = moved
        if change < _CONVERGED:
            return ManyFits(u * scales, (values > 1.0).sum(axis=1), iteration)
    raise RefusedError(f"{_ITERATIONS} Gauss-Newton steps did not settle one of {count} identifications")
