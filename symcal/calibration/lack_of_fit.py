"""Whether the residuals are larger than the noise that is stated, or than postures measured again say it is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.fit.estimation import Fit
from symcal.fit.score import Score

Array = NDArray[np.float64]
Against = Literal["stated noise", "repeatability"]

ONE_POSTURE = 1e-4
"""rad, and mm / 1000: joint readings that differ by less are one posture measured again. Their residuals are compared,
in which the difference is accounted for."""
_FEWEST = 3  # degrees of freedom of repeated measurements that tell their scatter


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """One noise group against one thing.

    ratio: rms of what the model leaves over what it should leave. p: that it is so large by chance; None where nothing
    tells. dof: of the residuals, and of the repeated measurements where these are the judge.
    """

    group: str
    against: Against | None
    ratio: float | None = None
    p: float | None = None
    dof: float = 0.0
    repeated: float = 0.0

    @property
    def said(self) -> str:
        """In words."""
        if self.against is None or self.p is None:
            return "not judged: the noise is not stated, and no posture was measured again"
        return f"{self.ratio:.3g} times the {self.against} (p = {self.p:.2g})"


def lack_of_fit(fit: Fit, score: Score | None, groups: tuple[str, ...], q: Array) -> tuple[LackOfFit, ...]:
    """Every noise group against what there is to judge it by.

    Args:
        groups: their names, in the order of the measurement. q: joint readings, shape (N, dof), rad and 1000 mm.
    """
    found = []
    same = postures(q)
    for number, name in enumerate(groups):
        own = []
        squares, dof = fit.by_group.get(name, (0.0, 0.0))
        if name not in fit.estimated and dof > 1:
            own.append(
                LackOfFit(
                    name, "stated noise", float(np.sqrt(squares / dof)), float(scipy.special.chdtrc(dof, squares)), dof
                )
            )
        if score is not None:
            own += _against_repeats(name, number, score, same)
        found += own or [LackOfFit(name, None)]
    return tuple(found)


def postures(q: Array) -> NDArray[np.intp]:
    """Which poses are one posture: a number of each, shape (N,)."""
    if any(np.diff(np.sort(column)).min(initial=np.inf) > ONE_POSTURE for column in q.T):
        return np.arange(len(q))  # a joint that is never twice the same; loading what follows takes a fifth of a second
    pairs = scipy.spatial.cKDTree(q).query_pairs(ONE_POSTURE, p=np.inf, output_type="ndarray").reshape(-1, 2)
    graph = scipy.sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(q), len(q)))
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1], dtype=np.intp)


def _against_repeats(name: str, number: int, score: Score, same: NDArray[np.intp]) -> Iterator[LackOfFit]:
    """Pure error against the rest ([Draper1998] sec. 2.1)."""
    own = np.flatnonzero(score.rows.group == number)
    if not own.size:
        return
    values = np.where(score.rows.group == number, score.data, 0.0)
    pure, repeated = 0.0, 0.0
    blocks, there = score.rows.by_pose(values), score.rows.by_pose((score.rows.group == number).astype(float))
    for posture in np.flatnonzero(np.bincount(same) > 1):
        members = np.flatnonzero(same == posture)
        alike = members[(there[members] == there[members[0]]).all(axis=1)]
        if len(alike) > 1 and there[alike[0]].any():
            pure += float(np.sum((blocks[alike] - blocks[alike].mean(axis=0)) ** 2))
            repeated += (len(alike) - 1) * float(there[alike[0]].sum())
    dof = len(own) - float(np.sum(score.taken[own] ** 2)) - repeated
    rest = float(np.sum(score.data[own] ** 2)) - pure
    if repeated < _FEWEST or dof < 1 or pure <= 0:
        return
    ratio = max(rest, 0.0) / dof / (pure / repeated)
    yield LackOfFit(
        name, "repeatability", float(np.sqrt(ratio)), float(scipy.special.fdtrc(dof, repeated, ratio)), dof, repeated
    )
