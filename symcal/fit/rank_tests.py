"""Tests by ranks, from the distribution functions of `scipy.special`: `scipy.stats` takes a second to load."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

_FEW = 8  # of either sample, up to which the distribution of U is counted out where there are no ties


def mean_ranks(values: Array) -> Array:
    """Ranks from 1, shape (n,); equal values share the mean of theirs."""
    _, group, count = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    return np.asarray((last - (count - 1) / 2)[group])


def rank_correlation(x: Array, y: Array) -> tuple[float, float]:
    """Spearman's correlation of two samples, shape (n,) with n > 2, and its two-sided p by the t distribution
    ([Spearman1904]); neither sample is constant."""
    r = float(np.corrcoef(mean_ranks(x), mean_ranks(y))[0, 1])
    dof = len(x) - 2
    t = r * math.sqrt(dof / max((1 + r) * (1 - r), 1e-300))
    return r, float(2 * scipy.special.stdtr(dof, -abs(t)))


def larger(x: Array, y: Array) -> float:
    """One-sided p of x being no larger than y, shapes (n,) and (m,), by the rank sum of x ([Mann1947]): counted out for
    few values without ties, otherwise the normal approximation with corrections for ties and continuity."""
    n, m = len(x), len(y)
    ranks = mean_ranks(np.concatenate([x, y]))
    u = float(ranks[:n].sum()) - n * (n + 1) / 2
    _, ties = np.unique(ranks, return_counts=True)
    if min(n, m) <= _FEW and ties.max() == 1:
        ways = _ways(n, m)
        return float(ways[round(u) :].sum() / ways.sum())
    total = n + m
    variance = n * m / 12 * (total + 1 - float(np.sum(ties**3.0 - ties)) / (total * (total - 1)))
    if variance <= 0:  # all are equal
        return 1.0
    return float(scipy.special.ndtr(-(u - n * m / 2 - 0.5) / math.sqrt(variance)))


def _ways(n: int, m: int) -> Array:
    """In how many orders of n and m values U is 0, 1, ..., n m: the coefficients of the Gaussian binomial."""
    ways = np.zeros(n * m + 1)
    ways[0] = 1.0
    few, many = min(n, m), max(n, m)
    for i in range(1, few + 1):
        for k in range(len(ways) - 1, many + i - 1, -1):  # times 1 - q^(many + i)
            ways[k] -= ways[k - many - i]
        for k in range(i, len(ways)):  # over 1 - q^i
            ways[k] += ways[k - i]
    return ways
