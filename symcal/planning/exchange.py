"""Greedy choice and exchange of poses over a finite pool.

Poses are added one by one, each the best of the pool; then every chosen pose in turn gives way to the pool's best,
until a whole round changes nothing (the modified Fedorov algorithm of [Cook1980], after [Fedorov1972]; here a candidate
is a block of rows). The best is found without looking at everybody: score(M + I) <= score(M) + tr(slope(M) I) for a
concave score, so the pool is ranked by the right-hand side in one product, and only those are evaluated exactly that
can still win.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.planning.criteria import Criterion
from symcal.planning.packed import packed_squares, packed_weight

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

ROUNDS = 20
"""Exchange stops after so many rounds even if it still improves; five are usual."""

_BLOCK = 32  # candidates evaluated exactly at a time
_BLOCKS = 4  # no more than so many blocks: beyond, a candidate has hardly ever won
_FEW = 0.3  # of the pool: so few are ranked on their own, and more with everybody
_GAIN = 1e-9  # an exchange must raise the score by this
_RIDGE = 1e-7  # of the pool's mean information, added so that the first poses have a finite score


@dataclass(frozen=True, slots=True)
class Pool:
    """Poses to choose from.

    poses: shape (K, dof). rows: F at each, shape (K, m, n). unit: the poses in units of the working area, (K, dof).
    packed: the upper triangle of I = F^T F at each, shape (K, n (n + 1) / 2).
    """

    poses: Array
    rows: Array
    unit: Array
    packed: Array

    def __len__(self) -> int:
        return len(self.poses)

    def gains(self, slope: Array, index: Indices | None = None) -> Array:
        """tr(slope I_k) for each pose, or for those of an index, shape (K,)."""
        return np.asarray((self.packed if index is None else self.packed[index]) @ packed_weight(slope))

    def information(self, index: Indices) -> Array:
        """I_k for each index, shape (len, n, n)."""
        rows = self.rows[index]
        return np.asarray(rows.swapaxes(-1, -2) @ rows)


def pool_of(poses: Array, rows: Array, unit: Array) -> Pool:
    """A `Pool`; see there."""
    return Pool(poses, rows, unit, packed_squares(rows))


def exchange(
    pool: Pool,
    criterion: Criterion,
    count: int,
    fixed: Array,
    *,
    start: Indices | None = None,
    repeats: bool = False,
    distance: float = 0.0,
    keep_off: Array | None = None,
    progress: Callable[[Indices, float], None] | None = None,
) -> Indices:
    """Choose ``count`` poses of the pool.

    Args:
        fixed: information that is there anyway (priors, poses the user insists on), shape (n, n).
        start: an earlier choice to improve instead of the greedy one. repeats: a pose may be taken more than once.
        distance: smallest Euclidean distance between two poses in units of the working area.
        keep_off: further poses (same units) that ``distance`` holds against, shape (k, dof).
        progress: told the choice and its score after the greedy phase and each round.
    Returns:
        indices into the pool, shape (count,), in the order of choice.
    Raises:
        RefusedError: the pool has not so many poses, or not so many that are ``distance`` apart.
    """
    n = pool.rows.shape[-1]
    flat = pool.rows.reshape(-1, n)
    mean = flat.T @ flat / len(pool)
    ground = fixed + _RIDGE * (mean + np.trace(mean) / n * 1e-6 * np.eye(n))
    crowd = _Crowd(pool, distance, repeats, keep_off)
    chosen: list[int] = []
    total = ground
    for i in start if start is not None else ():
        crowd.add(int(i))
        chosen.append(int(i))
        total = total + pool.information(np.array([i]))[0]
    while len(chosen) < count:
        best, _ = _best(pool, criterion, total, crowd.open)
        if best < 0:
            raise RefusedError(_too_few(pool, count, len(chosen), distance))
        crowd.add(best)
        chosen.append(best)
        total = total + pool.information(np.array([best]))[0]
    score = float(criterion.score(total))
    if progress:
        progress(np.array(chosen, dtype=np.intp), score)
    for _ in range(ROUNDS):
        before, promise = score, None
        for place in range(count):
            old = chosen[place]
            if promise is None:
                promise = _promise(pool, criterion, total, crowd.open)
            if promise.spread(old) <= 0.5 * _GAIN and crowd.loose:
                continue
            rest = total - pool.information(np.array([old]))[0]
            crowd.remove(old)
            better = crowd.open & promise.better(old, 0.5 * _GAIN)
            best, reached = _best(pool, criterion, rest, better, beat=score + _GAIN)
            if best >= 0:
                chosen[place], score, promise = best, reached, None
                total = rest + pool.information(np.array([best]))[0]
            crowd.add(chosen[place])
        # sums of many swaps drift: start each round from the exact one
        total = ground + pool.information(np.array(chosen, dtype=np.intp)).sum(axis=0)
        score = float(criterion.score(total))
        if progress:
            progress(np.array(chosen, dtype=np.intp), score)
        if score <= before + 10 * _GAIN:
            break
    return np.array(chosen, dtype=np.intp)


def _best(pool: Pool, criterion: Criterion, total: Array, open_: Mask, beat: float = -np.inf) -> tuple[int, float]:
    """The open pose whose addition scores best, and that score; -1 if none beats ``beat``."""
    places = np.flatnonzero(open_)
    if len(places) == 0:
        return -1, beat
    few = len(places) < _FEW * len(pool)
    gains = pool.gains(criterion.slope(total), places) if few else pool.gains(criterion.slope(total))[places]
    bound = float(criterion.score(total)) + gains
    bound = np.where(np.isfinite(bound), bound, -np.inf)
    best, reached = -1, beat
    ranked = _largest(bound, _BLOCK * _BLOCKS)
    for start in range(0, len(ranked), _BLOCK):
        block = ranked[start : start + _BLOCK]
        if criterion.concave:
            block = block[bound[block] > reached]
        block = places[block[np.isfinite(bound[block])]]
        if len(block) == 0:
            break
        scores = criterion.with_each(total, pool.rows[block])
        top = int(np.argmax(scores))
        if scores[top] > reached:
            best, reached = int(block[top]), float(scores[top])
    return best, reached


@dataclass(frozen=True, slots=True)
class _Promise:
    """What an exchange can gain at most at the present total: for a concave score no more than tr(slope (I_new -
    I_old)).

    gains: of every pose. best: of the open ones. Both infinite where the score is not concave.
    """

    gains: Array
    best: float

    def spread(self, old: int) -> float:
        return float(self.best - self.gains[old])

    def better(self, old: int, gain: float) -> Mask:
        """Poses that can take the place of one and gain so much, shape (K,)."""
        if not np.isfinite(self.best):
            return np.ones(len(self.gains), dtype=np.bool_)
        return np.asarray(~(self.gains - self.gains[old] <= gain))


def _promise(pool: Pool, criterion: Criterion, total: Array, open_: Mask) -> _Promise:
    gains = pool.gains(criterion.slope(total)) if criterion.concave else np.zeros(len(pool))
    best = float(np.max(gains, initial=-np.inf, where=open_)) if criterion.concave else np.inf
    return _Promise(gains, best if np.isfinite(gains).all() else np.inf)


def _largest(values: Array, count: int) -> Indices:
    """Indices of the largest values, descending; ties by index, so that nothing depends on the machine."""
    few = np.argpartition(values, -count)[-count:] if len(values) > count else np.arange(len(values))
    return few[np.lexsort((few, -values[few]))]


class _Crowd:
    """Which poses of the pool are still open, given those that are chosen; lives only inside `exchange`."""

    def __init__(self, pool: Pool, distance: float, repeats: bool, keep_off: Array | None) -> None:
        self._pool = pool
        self._distance = distance
        self._repeats = repeats and distance == 0
        self._near = np.zeros(len(pool), dtype=np.intp)  # how many chosen poses stand in the way of each
        if distance > 0 and keep_off is not None:
            for pose in keep_off:
                self._near += self._close(pose)

    @property
    def loose(self) -> bool:
        """Whether a pose that is taken away opens no other than itself."""
        return self._distance == 0

    @property
    def open(self) -> Mask:
        return np.asarray(self._near == 0)

    def add(self, index: int) -> None:
        self._change(index, 1)

    def remove(self, index: int) -> None:
        self._change(index, -1)

    def _change(self, index: int, by: int) -> None:
        if self._distance > 0:
            near = self._close(self._pool.unit[index])
            near[index] = True
            self._near += by * near
        elif not self._repeats:
            self._near[index] += by

    def _close(self, pose: Array) -> Mask:
        return np.asarray(np.sum((self._pool.unit - pose) ** 2, axis=1) < self._distance**2)


def _too_few(pool: Pool, count: int, found: int, distance: float) -> str:
    apart = f" at a distance of {distance:g} of the working area from each other" if distance > 0 else ""
    return f"{count} poses are wanted, and of {len(pool)} possible ones only {found} can be taken{apart}"
