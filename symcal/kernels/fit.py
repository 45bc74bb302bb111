"""The compiled identification of many problems at once, and what is passed to it."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.kernels.compiled import address, entry_of
from symcal.kernels.fit_source import ENTRY, Layout, fit_source
from symcal.kernels.instructions import Program

Array = NDArray[np.float64]


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
    prior: Array
    width: Array

    def __call__(
        self,
        q: Array,
        x: Array,
        setup: Array,
        z: Array,
        weights: Array | None,
        unit: float,
        small: float,
        nothing: float,
        evaluations: int,
    ) -> Minima:
        """Solve R problems.

        Args:
            q, setup, weights: contiguous, as the layout says. x: start, shape (n,) or (R, n). z: shape (R, N, nz).
            unit: what rows of known values and priors are multiplied by. small, nothing: a fall of the cost that does
            not count, as a share of it and in itself. evaluations: at most.
        Raises:
            MemoryError: there is no room for the values of one problem in each lane.
        """
        count, n, k = len(z), x.shape[-1], len(self.width)
        found, cost = np.empty((count, n)), np.empty(count)
        factor, counts = np.empty((count, k * (k + 1) // 2)), np.empty((count, 3), dtype=np.int64)
        job = _Job(
            count,
            z.shape[1],
            n if x.ndim == 2 else 0,
            *map(address, (q, x, setup, z)),
            None if weights is None else address(weights),
            *map(address, (self.prior, self.width)),
            unit,
            small,
            nothing,
            evaluations,
            *map(address, (found, cost, factor, counts)),
        )
        if self.entry(ctypes.addressof(job)):
            raise MemoryError(f"{z.shape[1]} poses of one problem in each lane")
        return Minima(found, cost, factor, counts)


def fit_kernel(
    program: Program, layout: Layout, known: Program | None, prior: Array, width: Array, *, portable: bool
) -> FitKernel | None:
    """Compile (or find compiled) the identification of a measurement; None where there is no compiler.

    Args:
        program, layout, known: see `fit_source`. prior: upper triangular rows of what is known before, shape (k, k).
        width: scales of the damping, shape (k,). portable: see `symcal.kernels.path.path_in_use`.
    """
    source = fit_source(program, layout, known, portable=portable)
    entry = entry_of(source, ENTRY, len(program.instructions), portable=portable)
    if entry is None:
        return None
    entry.argtypes, entry.restype = [ctypes.c_void_p], ctypes.c_int
    return FitKernel(entry, np.ascontiguousarray(prior), np.ascontiguousarray(width))
