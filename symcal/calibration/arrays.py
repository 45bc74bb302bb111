"""An identification from plain arrays: one set of readings, or many, with known noise and a model that was built."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symcal.errors import InputError
from symcal.fit.many import ManyFits, fit_many
from symcal.model.measurement import Setup
from symcal.model.model import Model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ArraysFit:
    """The estimate from one set of readings; what takes longer than the fit is computed when it is asked for.

    fits: the same as the only one of many, which says what everything is.
    """

    fits: ManyFits

    @property
    def x(self) -> Array:
        """Errors of all parameters, mm and rad, shape (n,)."""
        return np.asarray(self.fits.x[0])

    @cached_property
    def errors(self) -> dict[str, float]:
        """The same by name."""
        return self.fits.errors(0)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the estimated parameters, k of them."""
        return self.fits.free

    @property
    def cost(self) -> float:
        """Half the squared whitened residuals, priors included."""
        return float(self.fits.cost[0])

    @property
    def iterations(self) -> int:
        return int(self.fits.iterations[0])

    @property
    def converged(self) -> bool:
        return bool(self.fits.converged[0])

    @property
    def rank(self) -> int:
        """Directions of which the readings tell more than a plausible size."""
        return int(self.fits.rank[0])

    @property
    def dof(self) -> float:
        """Equations less the number of parameters learnt from them."""
        return float(self.fits.dof[0])

    @property
    def covariance(self) -> Array:
        """Of the free parameters, mm and rad, shape (k, k)."""
        return np.asarray(self.fits.covariance[0])


def identify_arrays(
    model: Model,
    q: ArrayLike,
    z: ArrayLike,
    sigma: ArrayLike,
    *,
    free: tuple[str, ...] | None = None,
    start: ArrayLike | None = None,
    setup: Setup | ArrayLike | None = None,
) -> ArraysFit | ManyFits:
    """The free parameters from one set of readings, z of shape (N, nz), or of each of R sets, (R, N, nz).

    Other arguments and errors as of `symcal.fit.many.fit_many`.
    """
    readings = np.asarray(z, dtype=np.float64)
    if readings.ndim == 3:
        return fit_many(model, q, readings, sigma, free=free, start=start, setup=setup)
    if readings.ndim != 2:
        raise InputError("readings must have the shape (N, nz) or (R, N, nz)", key="z", found=readings.shape)
    return ArraysFit(fit_many(model, q, readings[None], sigma, free=free, start=start, setup=setup))
