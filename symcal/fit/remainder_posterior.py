r"""What is not known of a prediction with a smooth remainder.

With A = E[t | J], the coefficients that the process would have if the slopes of the data were what displaces, an error
dx of the parameters moves a prediction by (J - R b^T A) dx: what the parameters get wrong at the data the process takes
back. The process itself adds what is left of its variance, and all of it far from the data ([Rasmussen2006] eq. 2.42).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.joints.remainder import Remainder

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RemainderPosterior:
    """directions: V, shape (M, k); told: share of the variance along each that the data tell, (k,).
    slopes: A by the free parameters, (M, 3, n)."""

    remainder: Remainder
    directions: Array
    told: Array
    slopes: Array

    def corrected(self, q: Array, jacobian: Array, base: Array) -> Array:
        """Jacobian of points (N, 3 k, n) with what the remainder takes back. base: its axes in world, (3, 3)."""
        taken = np.einsum("nm,mjp->njp", self.remainder.basis(q), self.slopes)
        turned = np.einsum("ij,njp->nip", base, taken)
        return np.asarray(jacobian - np.tile(turned, (1, jacobian.shape[1] // 3, 1)))

    def variance(self, q: Array) -> Array:
        """Of a component of the displacement for given parameters, shape (N,), mm^2."""
        left = 1 - (self.remainder.basis(q) @ self.directions) ** 2 @ self.told
        return np.asarray(self.remainder.amplitude**2 * np.clip(left, 0.0, 1.0))
