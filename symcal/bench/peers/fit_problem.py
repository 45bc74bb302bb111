"""One identification, in words that every tool understands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FitProblem:
    """min |(p(x) - z) / sigma|^2 + |x / size|^2 over the free errors, from zero; the others are zero.

    z: positions, shape (N, 3), mm. sigma: their noise. free: columns of x. sizes: of all x, shape (n,), None: no prior.
    """

    z: Array
    sigma: float
    free: NDArray[np.intp]
    count: int
    sizes: Array | None

    def whole(self, y: Array) -> Array:
        """All errors from the free ones."""
        x = np.zeros(self.count)
        x[self.free] = y
        return x

    def rows(self, p: Array, y: Array) -> Array:
        r = ((p - self.z) / self.sigma).ravel()
        return r if self.sizes is None else np.concatenate([r, y / self.sizes[self.free]])

    def slopes(self, jacobian: Array) -> Array:
        wide = jacobian.reshape(-1, self.count)[:, self.free] / self.sigma
        return wide if self.sizes is None else np.vstack([wide, np.diag(1 / self.sizes[self.free])])

    def cost(self, p: Array, x: Array) -> float:
        """Half of what is minimised, at errors x, shape (n,), with the positions that they give, shape (N, 3)."""
        rows = self.rows(p, x[self.free])
        return 0.5 * float(rows @ rows)
