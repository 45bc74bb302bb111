"""Estimates without some of the poses, from one linearised fit: what a fit without them would have given."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from symcal.fit.variances import VarianceModel, Variances

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
    linear, spread = system.rows.at(x), model.spread(variances)
    known = system.known_rows(x, variances.factors)
    for fold in folds:
        own = spread.copy()
        own[fold] = np.inf
        rows = system.picked(linear, own)
        stacked = np.vstack([rows, known])
        y = np.linalg.lstsq(stacked[:, :-1], -stacked[:, -1], rcond=None)[0]
        loose = np.flatnonzero(system.before.nearly_free & ~rows[:, :-1].any(axis=0))
        if loose.size:
            own = np.full_like(spread, np.inf)
            own[fold] = spread[fold]
            told = system.picked(linear, own)
            left = told[:, :-1] @ y + told[:, -1]
            y[loose] -= np.linalg.lstsq(told[:, loose], left, rcond=None)[0]
        step = np.zeros(len(x))
        step[system.index] = system.scales * y
        yield fold, step


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
