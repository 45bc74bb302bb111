"""Estimates without some of the poses, from one linearised fit: what a fit without them would have given."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from symcal.fit.variance_components import compressed
from symcal.fit.variances import VarianceModel, Variances
from symcal.fit.whitened import Whitened
from symcal.solvers.appended import appended

Array = NDArray[np.float64]
Fold = NDArray[np.intp]


def steps_without(
    model: VarianceModel, x: Array, variances: Variances, folds: Sequence[Fold]
) -> Iterator[tuple[Fold, Array]]:
    """Every fold with the change of all parameters when it is left out, shape (p,), mm and rad.

    The estimate of every fold is that of the model linearised at ``x``, at the variances of the whole. Places and
    points that only the fold's poses tell of are fitted to these.

    Args:
        folds: numbers of poses that are left out together.
    """
    system = model.system
    known = system.known_rows(x, variances.factors)
    for fold, others, own in _apart(model, x, variances, folds):
        stacked = np.vstack([others, known])
        y = np.linalg.lstsq(stacked[:, :-1], -stacked[:, -1], rcond=None)[0]
        loose = np.flatnonzero(system.before.nearly_free & ~others[:, :-1].any(axis=0))
        if loose.size:
            told = own()
            left = told[:, :-1] @ y + told[:, -1]
            y[loose] -= np.linalg.lstsq(told[:, loose], left, rcond=None)[0]
        step = np.zeros(len(x))
        step[system.index] = system.scales * y
        yield fold, step


def _apart(
    model: VarianceModel, x: Array, variances: Variances, folds: Sequence[Fold]
) -> Iterator[tuple[Fold, Array, Callable[[], Array]]]:
    """Every fold with the whitened rows of all other poses, shape (k, n + 1), and its own."""
    system, spread = model.system, model.spread(variances)
    if system.rows.many:
        triangles, rest = _by_fold(system, x, spread, folds)
        for i, fold in enumerate(folds):
            others = np.vstack([rest, *(each for k, each in enumerate(triangles) if k != i)])
            yield fold, appended(np.zeros((0, others.shape[1])), others), partial(triangles.__getitem__, i)
        return
    linear = system.rows.at(x)
    for fold in folds:
        others, own = spread.copy(), np.full_like(spread, np.inf)
        others[fold] = np.inf
        own[fold] = spread[fold]
        yield fold, system.picked(linear, others), partial(system.picked, linear, own)


def _by_fold(system: Whitened, x: Array, spread: Array, folds: Sequence[Fold]) -> tuple[list[Array], Array]:
    """The triangle of the rows of every fold, and that of poses which are in none."""
    rest = np.ones(len(spread), dtype=np.bool_)
    for fold in folds:
        rest[fold] = False

    def triangle(poses: Fold) -> Array:
        if not poses.size:
            return np.zeros((0, len(system.free) + 1))
        return compressed(replace(system, rows=system.rows.take(poses)).data_rows(x, spread[poses]))

    return [triangle(fold) for fold in folds], triangle(np.flatnonzero(rest))


def folds_of(model: VarianceModel, count: int) -> list[Fold]:
    """Poses that are left out together, each in one fold, ``count`` of them where there are so many poses.

    Those that touch one unknown place, where there are several, since the place is fitted to them and hides what they
    have in common; else random ones.
    """
    rows = model.system.rows
    parts = [part for part in rows.measurement.parts if part.observation.instrument.constrains]
    places = [np.flatnonzero(rows.seen[:, part.components].any(axis=1)) for part in parts]
    places = [poses for poses in places if poses.size]
    if len(places) > 1 and len(parts) == len(rows.measurement.parts):
        return places
    poses = len(rows.data)
    order = np.random.default_rng(0).permutation(poses)
    return [np.sort(order[i::count]) for i in range(min(count, poses))]
