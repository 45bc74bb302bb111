"""`fit_many` of the kernel that identifies one problem per lane, behind the one name that trials use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.model.model import Model
from symcal.paper import batch_fit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ManyFits:
    """R fits: x, shape (R, n), mm and rad; cost, rank, iterations and converged, shape (R,)."""

    x: Array
    cost: Array
    rank: NDArray[np.intp]
    iterations: NDArray[np.intp]
    converged: NDArray[np.bool_]


def fit_many(model: Model, q: Array, z: Array, sigma: Array, *, free: Sequence[str]) -> ManyFits:
    one = float(sigma[0])
    x, rank, iterations = [], [], []
    for i in range(len(z)):  # one by one: a batch here iterates until its slowest has settled
        found = batch_fit.fit_many(model, q if q.ndim == 2 else q[i], z[i : i + 1], one)
        x.append(found.x[0])
        rank.append(found.ranks[0])
        iterations.append(found.iterations)
    count = len(z)
    return ManyFits(
        np.array(x), np.full(count, np.nan), np.array(rank), np.array(iterations), np.ones(count, dtype=np.bool_)
    )
