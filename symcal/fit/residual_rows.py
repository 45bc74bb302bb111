"""A dataset's residuals as a function of the parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.instruments import Measurement, Setup
from symcal.kernels import BatchFunction, batch_function

Array = NDArray[np.float64]

_NO_VARIANCE = 1e-13
"""Variances below this share of a pose's largest are rounding of none at all."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Residuals of a dataset: x -> r (N, m) and J (N, m, n); components that were not measured are zero.

    mixing: whitening matrix of every pose, shape (N, m, m), applied to both; None where components stay as they are.
    """

    measurement: Measurement
    data: Dataset
    setup: Setup
    kernel: BatchFunction
    z: Array
    seen: NDArray[np.bool_]
    mixing: Array | None = None

    def __call__(self, x: Array) -> tuple[Array, Array]:
        r, jacobian = self.kernel(self.data.q, x, self.setup.vector, self.z)
        if self.mixing is not None:
            r, jacobian = np.einsum("nij,nj->ni", self.mixing, r), self.mixing @ jacobian
        if self.seen.all():
            return r, jacobian
        return np.where(self.seen, r, 0.0), np.where(self.seen[:, :, None], jacobian, 0.0)

    def decorrelated(self) -> Rows:
        """The rows in the principal axes of the data's covariance, of unit variance; as they are without one.

        With C = U diag(c) U^T the rows are diag(c)^-1/2 U^T r; those without variance are left out as not measured.
        """
        if self.data.covariance is None:
            return self
        variance, axes = np.linalg.eigh(self.data.covariance)
        kept = variance > _NO_VARIANCE * variance[:, -1:]
        scale = np.where(kept, 1 / np.sqrt(np.where(kept, variance, 1.0)), 0.0)
        return replace(self, mixing=scale[:, :, None] * axes.swapaxes(1, 2), seen=kept)


def rows_of(measurement: Measurement, data: Dataset, setup: Setup, kernel: BatchFunction | None = None) -> Rows:
    """The residual rows of a dataset under a setup; a kernel made before may be used again."""
    kernel = kernel or batch_function(measurement.residual)
    whole = np.ones((len(data), measurement.rows), dtype=np.bool_)
    seen = np.isfinite(data.z) if measurement.kind.reads_points else whole
    return Rows(measurement, data, setup, kernel, np.nan_to_num(data.z), seen)
