"""Our own identifications, many at once and single, as a program would call them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from symcal.bench.case import Case
from symcal.bench.rounds import Contender
from symcal.paper.batch_fit import fit_many

Array = NDArray[np.float64]


def free_of(case: Case, rng: np.random.Generator) -> tuple[str, ...]:  # noqa: ARG001
    """The parameters that are identified."""
    return case.names


def many(case: Case, q: Array, z: Array, sigma: float) -> Callable[[], Array]:
    """All sets of readings z, shape (R, N, 3), in one call that gives errors, shape (R, n)."""
    return lambda: fit_many(case.model, q, z, sigma).x


def single(case: Case, q: Array, z: Array, sigma: float) -> Callable[[], Array]:
    """The first set alone: errors, shape (n,)."""
    return lambda: fit_many(case.model, q, z[:1], sigma).x[0]


def entries(case: Case, q: Array, z: Array, sigma: float) -> Iterator[Contender]:
    """Each way to call them."""
    yield Contender(f"symcal, {len(z)} at once", many(case, q, z, sigma), len(z), "one call")
    yield Contender("symcal, single", single(case, q, z, sigma), 1, "one call")
