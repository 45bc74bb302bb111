r"""Which groups of joint terms the data ask for: marginal likelihood with and without, and held-out poses.

At the estimate x of the model with all groups, linearised, the gain of a group is

    2 (max log L - max log L with the factor of the group held at nothing)

where noise and the factors of the other groups are found again (`symcal.fit.variance_components`). Groups share what
they can: so the group of least gain is left out first, and the gains of the others are found again, until all that are
left gain enough. Ours. A variance that is truly zero gains nothing in half of all data and chi-squared of one degree of
freedom in the other half ([SelfLiang1987]), which says how much is enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.fit.held_out import steps_without
from symcal.fit.variance_components import Block, Components, most_likely
from symcal.fit.variances import NOTHING, VarianceModel, Variances, size_name

Array = NDArray[np.float64]

FALSE = 0.02
"""Probability that any of the candidates is kept where none is needed."""

_TOLERANCE = 1e-4


def enough(candidates: int) -> float:
    """Twice the gain in log marginal likelihood above which one of so many groups is kept; 6.6 of four."""
    return float(scipy.special.chdtri(1, 2 * FALSE / max(candidates, 1)))


@dataclass(frozen=True, slots=True)
class Elimination:
    """gains: of every candidate, when it was left out or in the end. kept: the groups that are left."""

    gains: dict[str, float]
    kept: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Groups:
    """A fit with groups of joint terms, linearised at its estimate; made by `groups_at`."""

    model: VarianceModel
    x: Array
    variances: Variances
    names: list[str]
    blocks: list[Block]
    fixed: Array
    # What `without` has found; filled on first use, never changed after.
    _found: dict[frozenset[str], Components] = field(default_factory=dict, compare=False, repr=False)

    def without(self, groups: Sequence[str]) -> Components:
        """The model of largest marginal likelihood where the factors of these groups are nothing."""
        key = frozenset(groups)
        if key not in self._found:
            self._found[key] = self._most_likely(groups)
        return self._found[key]

    def _most_likely(self, groups: Sequence[str]) -> Components:
        nothing = 2 * np.log(NOTHING)
        held = {size_name(group) for group in groups}
        blocks = [
            replace(block, lowest=nothing, highest=nothing) if name in held else block
            for name, block in zip(self.names, self.blocks, strict=True)
        ]
        start = self.model.phi(self.names, self.variances)
        ties = self.model.ties(self.names)
        tries = [start, np.where([name in held or name in self.model.estimated for name in self.names], start, 0.0)]
        return min(
            (most_likely(blocks, self.fixed, each, ties, tolerance=_TOLERANCE) for each in tries),
            key=lambda found: found.value,
        )

    def eliminated(self, candidates: Sequence[str], gone: Sequence[str] = ()) -> Elimination:
        """The candidates without those that gain too little, one after the other.

        Args:
            gone: groups that are left out anyway.
        """
        left, gone, gains = list(candidates), list(gone), dict[str, float]()
        wanted = enough(len(left) + len(gone))
        while left:
            base = self.without(gone).value
            own = {group: self.without([*gone, group]).value - base for group in left}
            gains |= own
            worst = min(left, key=lambda group: own[group])
            if own[worst] > wanted:
                break
            left.remove(worst)
            gone.append(worst)
        return Elimination(gains, tuple(left))

    def variances_without(self, groups: Sequence[str]) -> Variances:
        """The variances that go with `without`."""
        return self.model.named(self.names, self.without(groups).phi, self.variances)

    def covariance(self, group: str) -> Array:
        """Of the free parameters, were a group as large as is plausible, shape (n, n): what the data tell of it."""
        system, given = self.model.system, replace(self.variances, factors=self.variances.factors | {group: 1.0})
        rows = self.model.rows_with(given)(self.x)[:, :-1]
        root = scipy.linalg.solve_triangular(np.linalg.qr(rows, mode="r"), np.eye(rows.shape[1]))
        return np.asarray(np.outer(system.scales, system.scales) * (root @ root.T))

    def held_out(self, groups: Sequence[str], folds: Sequence[NDArray[np.intp]]) -> Array:
        """Residuals of poses in folds that were not used for them, shape (N, m), without some groups.

        The estimate of every fold is that of the linearised model at the variances of the whole. Places and points that
        only the held-out poses tell of are fitted to these.
        """
        variances, rows = self.variances_without(groups), self.model.system.rows
        out, of, steps = np.zeros(rows.seen.shape), np.zeros(len(rows.seen), dtype=np.intp), []
        for i, (fold, step) in enumerate(steps_without(self.model, self.x, variances, folds), start=1):
            of[fold] = i
            steps.append(step)
        every = np.array([np.zeros(len(self.x)), *steps])
        for own, part in rows.pieces():
            out[own] = np.where(of[own, None] > 0, part.at(self.x).moved(every[of[own]]), 0.0)
        return out


def groups_at(model: VarianceModel, x: Array, variances: Variances) -> Groups:
    """The fit of a variance model with its result."""
    names, blocks, fixed = model.linearised(x, variances)
    return Groups(model, x, variances, names, blocks, fixed)
