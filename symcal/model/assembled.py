"""What all observations read, with their slopes and errors, side by side: written-out expressions and staged ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.kernels import BatchFunction, batch_function
from symcal.kernels.path import Choice
from symcal.model.measurement import Measurement, Part
from symcal.model.staged_kernel import StagedKernel

Array = NDArray[np.float64]
RowKernel = BatchFunction | StagedKernel
"""(q, x, setup, z) -> r, shape (N, m), and J, shape (N, m, n), of one observation."""


@dataclass(frozen=True, slots=True)
class Assembled:
    """A function of all observations, from one of those that are written out and one for each staged one.

    written: of the former, None without any; columns: where its values belong. readings: the z that it takes, if it
    takes one. staged: where values of the others belong, the z that they take, and their functions. size: of the whole.
    """

    written: BatchFunction | None
    columns: NDArray[np.intp]
    readings: NDArray[np.intp]
    staged: tuple[tuple[slice, slice, Callable[..., Array]], ...]
    size: int

    def __call__(self, q: Array, x: Array, setup: Array, *z: Array) -> tuple[Array]:
        found: list[tuple[slice | NDArray[np.intp], Array]] = [
            (columns, value(q, x, setup, *(each[:, readings] for each in z)))
            for columns, readings, value in self.staged
        ]
        if self.written is not None:
            own = (each[:, self.readings] for each in z)
            found.append((self.columns, self.written(q, x, setup, *own)[0]))
        out = np.empty((len(q), self.size, *found[0][1].shape[2:]))
        for columns, values in found:
            out[:, columns] = values
        return (out,)


@dataclass(frozen=True, slots=True)
class Margins:
    """(q, x, setup) -> by how much each feature of one observation can be read, shape (N, features, limits)."""

    written: BatchFunction
    features: int

    def __call__(self, q: Array, x: Array, setup: Array) -> Array:
        (margins,) = self.written(q, x, setup)
        return np.asarray(margins.reshape(len(q), self.features, -1))


def rows_kernel(part: Part, choice: Choice = "auto") -> RowKernel:
    """Residuals of one observation and their slopes."""
    return part.residual if isinstance(part.residual, StagedKernel) else batch_function(part.residual, backend=choice)


def readings_kernel(measurement: Measurement, evaluations: int | None = 0) -> BatchFunction | Assembled:
    """(q, x, setup) -> the readings of all instruments, shape (N, nz)."""
    whole = _written(measurement, measurement.predict, evaluations, "auto")
    return _assembled(measurement, whole, lambda part: part.readings, StagedKernel.readings)


def slopes_kernel(measurement: Measurement, choice: Choice = "auto") -> BatchFunction | Assembled:
    """(q, x, setup) -> J at zero residual, shape (N, m, n)."""
    whole = _written(measurement, measurement.jacobian, 0, choice)
    return _assembled(measurement, whole, lambda part: part.components, StagedKernel.jacobian)


def errors_kernel(
    measurement: Measurement, evaluations: int | None, choice: Choice = "auto"
) -> BatchFunction | Assembled:
    """(q, x, setup, z) -> what is judged, shape (N, ne)."""
    return _assembled(
        measurement,
        _written(measurement, measurement.accuracy, evaluations, choice),
        lambda part: slice(part.errors.start, part.attitudes.stop),
        StagedKernel.errors,
    )


def margins_kernel(part: Part, evaluations: int | None = None) -> Callable[[Array, Array, Array], Array] | None:
    """See `Margins`; None without limits."""
    if part.staged is not None:
        return part.staged.margins
    return (
        None if part.margins is None else Margins(batch_function(part.margins, evaluations=evaluations), part.features)
    )


def _written(
    measurement: Measurement, function: ca.Function, evaluations: int | None, choice: Choice
) -> BatchFunction | None:
    """The function of the observations that are written out, if there are any."""
    if all(part.staged is not None for part in measurement.parts):
        return None
    return batch_function(function, backend=choice, evaluations=evaluations)


def _assembled(
    measurement: Measurement,
    whole: BatchFunction | None,
    where: Callable[[Part], slice],
    value: Callable[..., Array],
) -> BatchFunction | Assembled:
    written = [part for part in measurement.parts if part.staged is None]
    if whole is not None and len(written) == len(measurement.parts):
        return whole
    staged = [(where(part), part.readings, part.staged) for part in measurement.parts if part.staged is not None]
    return Assembled(
        whole,
        _numbers([where(part) for part in written]),
        _numbers([part.readings for part in written]),
        tuple((at, readings, value.__get__(kernel)) for at, readings, kernel in staged),
        max(where(part).stop for part in measurement.parts),
    )


def _numbers(slices: list[slice]) -> NDArray[np.intp]:
    return np.concatenate([np.zeros(0, dtype=np.intp), *(np.arange(each.start, each.stop) for each in slices)])
