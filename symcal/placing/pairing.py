"""Views that do not fit the joint readings of their names, and those that they fit instead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.placing.agreement import Agreement

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_OFF, _LOST = 8.0, 15.0  # of the scatter of the others: from there a view fits another posture, or none
_BETTER = 0.3  # of its own misfit: the most that is left at another posture that it fits
_BOTH = 4.5  # of the scatter: two views that each fit the other's posture need to be off by less
_TAKEN = 50.0  # of the scatter: what a posture that has a view already costs
_SIGMAS = 6.0  # of a view's own uncertainty, which counts as much as the scatter of the others
_LEAST = 0.3  # mm: scatter below which nobody's joint readings are


@dataclass(frozen=True, slots=True)
class Foreign:
    """A view that does not fit the posture of its name.

    fits: the posture that it fits; None if it fits none. off, there: its misfit at its own and at that posture, mm.
    """

    view: int
    fits: int | None
    off: float
    there: float


def foreign_views(found: Agreement, own: Index, sigma: Array) -> list[Foreign]:
    """The views that do not belong to the posture of their names, each with the one that it belongs to, if any.

    A view is foreign where it is off by several times the scatter of the others, and another posture explains it far
    better; or none does, and it is off still more. Of nearly equal postures nothing is said. The postures are given
    out so that all foreign views fit best together (an assignment).

    Args:
        own: posture of each view by its name, shape (N,). sigma: uncertainty of each view alone, shape (N,), mm.
    """
    scatter = np.maximum(found.typical, _LEAST)
    ruler = np.sqrt(scatter**2 + (_SIGMAS / _OFF * np.nan_to_num(sigma, nan=np.inf)) ** 2)
    off = found.misfit[np.arange(len(own)), own]
    suspects = np.flatnonzero((off > _OFF * ruler) | _exchanged(found.misfit[:, own], off, ruler))
    if not len(suspects):
        return []
    taken = np.zeros(found.misfit.shape[1])
    taken[np.delete(own, suspects)] = _TAKEN
    relative = found.misfit[suspects] / ruler[suspects, None]
    fitting = (relative < _OFF) & (found.misfit[suspects] < _BETTER * off[suspects, None])
    cost = np.where(fitting, relative + taken, 1e6)
    rows, columns = scipy.optimize.linear_sum_assignment(cost)
    fits = {int(suspects[r]): int(c) for r, c in zip(rows, columns, strict=True) if fitting[r, c]}
    foreign = []
    for i in suspects:
        j = fits.get(int(i))
        if j is None and fitting[list(suspects).index(i)].any():  # a posture that others fit as well
            j = int(np.argmin(found.misfit[i]))
        if j is not None or off[i] > _LOST * ruler[i]:
            foreign.append(Foreign(int(i), j, float(off[i]), np.nan if j is None else float(found.misfit[i, j])))
    return foreign


def _exchanged(misfit: Array, off: Array, ruler: Array) -> NDArray[np.bool_]:
    """Views (mask) that fit the posture of one that fits theirs: that both are off so by chance is far less likely."""
    there = (misfit < _BETTER * off[:, None]) & (misfit < _BOTH * ruler[:, None]) & (off > _BOTH * ruler)[:, None]
    return np.asarray((there & there.T).any(axis=1))
