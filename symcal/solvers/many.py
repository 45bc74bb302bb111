"""Levenberg-Marquardt on many systems of one size at once, by their triangles: what `kernels/fit.h` does, in numpy.

Every problem goes its own way: what is computed of it does not depend on its neighbours, and LAPACK sees one system at
a time. Vectors only; knows no robot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_FIRST_DAMPING, _LEAST_DAMPING = 1e-3, 1e-7
_CAUTION = 100.0


@dataclass(frozen=True, slots=True)
class Ends:
    """What was found of R problems, see `symcal.kernels.fit.Minima`.

    x: shape (R, n). cost: (R,). triangles: of the last rows, shape (R, n, n). steps, evaluations: (R,). finite: whether
    the start gave finite numbers; converged: both shape (R,).
    """

    x: Array
    cost: Array
    triangles: Array
    steps: NDArray[np.int64]
    evaluations: NDArray[np.int64]
    finite: NDArray[np.bool_]
    converged: NDArray[np.bool_]


def minimise_many(
    rows: Callable[[NDArray[np.intp], Array], Array],
    start: Array,
    width: Array,
    *,
    small: float,
    nothing: float,
    evaluations: int,
) -> Ends:
    """Minimise |r(x)|^2 / 2 of R problems, each from its own start.

    Args:
        rows: (numbers of A problems, their x, shape (A, n)) -> [J, r], shape (A, k, n + 1). start: shape (R, n).
        width: scales of the damping, shape (n,). small, nothing: a fall of the cost that does not count, as a share of
        it and in itself. evaluations: at most.
    """
    count, n = start.shape
    x, trial = start.copy(), start.copy()
    cost, damping, promise = np.full(count, np.inf), np.zeros(count), np.zeros(count)
    steps, tried = np.full(count, -1, dtype=np.int64), np.zeros(count, dtype=np.int64)
    triangles = np.zeros((count, n, n + 1))
    finite, converged = np.ones(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_)
    active = np.arange(count)
    for _ in range(evaluations):
        if not active.size:
            break
        system = rows(active, trial[active])
        usable = np.isfinite(system).all(axis=(1, 2))
        system[~usable] = 0.0
        with np.errstate(over="ignore"):  # infinitely bad then
            now = np.where(usable, 0.5 * np.sum(system[:, :, -1] ** 2, axis=1), np.inf)
        fresh = np.asarray(np.linalg.qr(system, mode="r"))[:, :n]
        before = cost[active]
        better = now < before
        finite[active[~better & np.isinf(before)]] = False
        went_on = active[better]
        tried[active] += 1
        steps[went_on] += 1
        x[went_on], cost[went_on], triangles[went_on] = trial[went_on], now[better], fresh[better]
        settled = better & np.isfinite(before)
        settled[settled] &= before[settled] - now[settled] <= small * before[settled]
        plain = damping[active] == 0
        less, more = damping[active] * 0.1, damping[active] * 10.0
        damping[active] = np.where(better, np.where(less > _LEAST_DAMPING, less, 0.0), np.maximum(more, _FIRST_DAMPING))
        kept = finite[active]
        active, better, settled, plain = active[kept], better[kept], settled[kept], plain[kept]
        if not active.size:
            break
        held = triangles[active]
        gain = 0.5 * np.sum(held[:, :, n] ** 2, axis=1)
        step = _steps(held)
        enough = small * cost[active] + nothing
        known = np.flatnonzero(better & plain & (promise[active] > 0))
        doubt, ratio = gain.copy(), np.sqrt(gain[known] / promise[active[known]])
        doubt[known] = np.minimum(_CAUTION * gain[known] * ratio, gain[known])
        last = better & (doubt <= enough)
        promise[active[better]] = gain[better]
        x[active[last]] += step[last]
        cost[active[last]] -= gain[last]
        stop = last | settled
        slow = np.flatnonzero(~stop & (damping[active] > 0))
        if slow.size:
            step[slow], promised = _damped(held[slow], damping[active[slow]], width)
            stop[slow] |= ~better[slow] & (promised <= enough[slow])
        converged[active[stop]] = True
        active, step = active[~stop], step[~stop]
        trial[active] = x[active] + step
    return Ends(x, cost, np.asarray(triangles[:, :, :n]), steps, tried, finite, converged)


def _steps(triangles: Array) -> Array:
    """s with R s = -g of [R, g], shape (A, n, n + 1)."""
    n = triangles.shape[1]
    step = np.zeros(triangles.shape[:2])
    with np.errstate(divide="ignore", invalid="ignore"):  # a direction that nothing sees: damping has to help
        for j in reversed(range(n)):
            sum_ = triangles[:, j, n].copy()
            for c in range(j + 1, n):
                sum_ += triangles[:, j, c] * step[:, c]
            step[:, j] = -sum_ / triangles[:, j, j]
    return step


def _damped(triangles: Array, damping: Array, width: Array) -> tuple[Array, Array]:
    """The damped steps, and the fall of the cost that they promise: damping |s / width|^2 + |R s|^2 / 2."""
    count, n, _ = triangles.shape
    own = np.zeros((count, 2 * n, n + 1))
    own[:, :n] = triangles
    own[:, n:, :n] = np.sqrt(damping)[:, None, None] * np.diag(1.0 / width)
    step = _steps(np.asarray(np.linalg.qr(own, mode="r"))[:, :n])
    moved = np.sum(triangles[:, :, :n] * step[:, None, :], axis=2)
    return step, damping * np.sum((step / width) ** 2, axis=1) + 0.5 * np.sum(moved**2, axis=1)
