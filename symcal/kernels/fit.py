"""The compiled identification of many problems at once, and what is passed to it."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.kernels.compile import load_library
from symcal.kernels.fit_source import ENTRY, Layout, fit_source
from symcal.kernels.instructions import Program

Array = NDArray[np.float64]

_LONG = 3000
"""More instructions than this would keep a compiler busy for seconds at -O3."""


class _Job(ctypes.Structure):
    """See fit.h."""

    _fields_ = [
        *((name, ctypes.c_ssize_t) for name in ("problems", "poses", "x_stride")),
        *((name, ctypes.c_void_p) for name in ("q", "x", "setup", "z", "w", "prior", "width")),
        *((name, ctypes.c_double) for name in ("unit", "small", "nothing", "evaluations")),
        *((name, ctypes.c_void_p) for name in ("found", "cost", "factor", "counts")),
    ]


@dataclass(frozen=True, slots=True)
class Minima:
    """What was found of R problems, in the units of the rows.

    x: all errors, shape (R, n). cost: half the squared rows. factor: upper triangle of all rows by the free errors, row
    by row, shape (R, k (k + 1) / 2). counts: accepted steps, evaluations, and how it ended (`CONVERGED`, `TOO_MANY`,
    `NOT_FINITE`), shape (R, 3).
    """

    x: Array
    cost: Array
    factor: Array
    counts: NDArray[np.int64]


CONVERGED, TOO_MANY, NOT_FINITE = 0, 1, 2


@dataclass(frozen=True, slots=True)
class FitKernel:
    """Made by `fit_kernel`: one problem in each lane, whatever the number and order of the problems."""

    entry: Callable[[int], int]
    free: int

    def __call__(
        self,
        q: Array,
        x: Array,
        setup: Array,
        z: Array,
        weights: Array | None,
        prior: Array,
        width: Array,
        unit: float,
        small: float,
        nothing: float,
        evaluations: int,
    ) -> Minima:
        """Solve R problems.

        Args:
            q, setup, weights: contiguous, as the layout says. x: start, shape (n,) or (R, n). z: shape (R, N, nz).
            prior: upper triangular rows of what is known before, shape (k, k). width: scales of the damping, shape
            (k,). unit: of the rows: those of known values are multiplied by it. small, nothing: a fall of the cost that
            does not count, as a share of it and in itself. evaluations: at most.
        Raises:
            MemoryError: there is no room for the values of one problem in each lane.
        """
        count, n = len(z), x.shape[-1]
        found, cost = np.empty((count, n)), np.empty(count)
        factor, counts = np.empty((count, self.free * (self.free + 1) // 2)), np.empty((count, 3), dtype=np.int64)
        job = _Job(
            count,
            z.shape[1],
            n if x.ndim == 2 else 0,
            *map(_address, (q, x, setup, z)),
            None if weights is None else _address(weights),
            _address(prior),
            _address(width),
            unit,
            small,
            nothing,
            evaluations,
            *map(_address, (found, cost, factor, counts)),
        )
        if self.entry(ctypes.addressof(job)):
            raise MemoryError(f"{z.shape[1]} poses of one problem in each lane")
        return Minima(found, cost, factor, counts)


def _address(array: NDArray[Any]) -> int:
    return int(array.__array_interface__["data"][0])


def fit_kernel(program: Program, layout: Layout, known: Program | None = None) -> FitKernel | None:
    """Compile (or find compiled) the identification of a measurement; None where there is no compiler.

    Args:
        program, layout, known: see `fit_source`.
    """
    library = load_library(
        fit_source(program, layout, known), "-O3" if len(program.instructions) < _LONG else "-O1", ENTRY
    )
    if library is None:
        return None
    entry = getattr(library, ENTRY)
    entry.argtypes, entry.restype = [ctypes.c_void_p], ctypes.c_int
    return FitKernel(entry, len(layout.free))
