"""Our own identifications, many at once and single, as a program would call them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

import symcal as sc
from symcal.bench.case import Case
from symcal.bench.rounds import Contender
from symcal.fit.many import fit_many

Array = NDArray[np.float64]


def many(case: Case, q: Array, z: Array, sigma: float, free: tuple[str, ...]) -> Callable[[], Array]:
    """All sets of readings z, shape (R, N, 3), in one call that gives errors, shape (R, n)."""
    return lambda: fit_many(case.model, q, z, sigma, free=free).x


def single(case: Case, q: Array, z: Array, sigma: float, free: tuple[str, ...]) -> Callable[[], Array]:
    """The first set alone, with the model built: errors, shape (n,)."""
    return lambda: sc.identify(case.model, q, z[0], sigma=sigma, free=free).x


def from_robot(case: Case, q: Array, z: Array, sigma: float, free: tuple[str, ...]) -> Callable[[], Array]:
    """The same beginning with the robot: errors, shape (n,)."""
    return lambda: sc.identify(sc.build_model(case.robot, case.model.task), q, z[0], sigma=sigma, free=free).x


def entries(case: Case, q: Array, z: Array, sigma: float, free: tuple[str, ...]) -> Iterator[Contender]:
    """Each way to call them."""
    given = (case, q, z, sigma, free)
    yield Contender(f"symcal, {len(z)} at once", many(*given), len(z), "one call of fit_many")
    yield Contender("symcal, single", single(*given), 1, "sc.identify with a model")
    yield Contender("symcal, single, with its model", from_robot(*given), 1, "sc.build_model and sc.identify")
