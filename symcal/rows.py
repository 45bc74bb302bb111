"""A dataset's residuals as a function of the parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.dataset import Dataset
from symcal.kernels import BatchFunction, batch_function
from symcal.measurements import Measurement, Setup

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Rows:
    """Residuals of a dataset: x -> r (N, m) and J (N, m, n); components that were not measured are zero."""

    measurement: Measurement
    data: Dataset
    setup: Setup
    kernel: BatchFunction
    z: Array
    seen: NDArray[np.bool_]

    def __call__(self, x: Array) -> tuple[Array, Array]:
        r, jacobian = self.kernel(self.data.q, x, self.setup.vector, self.z)
        if self.seen.all():
            return r, jacobian
        return np.where(self.seen, r, 0.0), np.where(self.seen[:, :, None], jacobian, 0.0)


def rows_of(measurement: Measurement, data: Dataset, setup: Setup, kernel: BatchFunction | None = None) -> Rows:
    """The residual rows of a dataset under a setup; a kernel made before may be used again."""
    kernel = kernel or residual_kernel(measurement)
    seen = np.isfinite(data.z) if measurement.kind != "pose" else np.ones((len(data), measurement.rows), dtype=bool)
    return Rows(measurement, data, setup, kernel, np.nan_to_num(data.z), seen)


def residual_kernel(measurement: Measurement) -> BatchFunction:
    """The residual as fast as this machine can; worth compiling even for one fit, since kernels are kept on disk."""
    return batch_function(measurement.residual)
