r"""The rows of a fit of very many poses, through their triangles alone.

Of whitened rows W = [J S, r] a fit asks for nothing but squared norms |W y|^2, which are those of the triangle of any
QR decomposition of W. Pieces of a few thousand rows are appended to it one after the other,

    [T; W_i] = Q_i T',    T'^T T' = T^T T + W_i^T W_i,

each by Householder reflections, so that no more than a piece is ever held, and nothing is squared that rounding could
spoil ([Golub2013] sec. 6.5.3). Rows of one noise group are kept apart from those of the others, as are readings of
known noise from those whose noise the data must tell: whatever the noise, the rows of all are a few triangles divided
by it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import blake2b

import numpy as np
from numpy.typing import NDArray

from symcal.fit.whitened import Whitened
from symcal.solvers.appended import appended

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_KEPT = 6  # points of which triangles are remembered: a fit looks at the last few again and again


@dataclass(frozen=True, slots=True)
class Groups:
    """Triangles at one x by noise group: of readings whose noise is unknown at unit variance, and of those whose noise
    is known, whitened by it. Robust weights are in both."""

    unknown: Mapping[str, Array]
    known: Mapping[str, Array]

    def whitened(self, sigmas: Mapping[str, float]) -> dict[str, Array]:
        """Group by group, whitened by these sigmas; of a group without one the readings of known noise alone."""
        out = dict(self.known)
        for name, rows in self.unknown.items():
            sigma = sigmas.get(name, np.nan)
            if np.isfinite(sigma):
                out[name] = np.vstack([rows / sigma, out[name]])
        return out


@dataclass(frozen=True, slots=True)
class Triangles:
    """Triangles of a system at the points that a fit asks for.

    known: standard deviation of each component, shape (N, m), NaN where unknown.
    """

    system: Whitened
    known: Array
    # What was found at the last few points; the same point gives the same.
    _found: dict[tuple[bytes, bytes], Groups] = field(default_factory=dict, compare=False, repr=False)
    _weights: list[tuple[Array, bytes]] = field(default_factory=list, compare=False, repr=False)

    def at(self, x: Array, weights: Array) -> Groups:
        """Args: weights: robust ones, shape (N, m)."""
        if not self._weights or self._weights[-1][0] is not weights:
            self._weights[:] = [(weights, blake2b(np.ascontiguousarray(weights).data).digest())]
        key = x.tobytes(), self._weights[-1][1]
        if key not in self._found:
            while len(self._found) >= _KEPT:
                del self._found[next(iter(self._found))]
            self._found[key] = self._at(x, weights)
        return self._found[key]

    def _at(self, x: Array, weights: Array) -> Groups:
        groups = self.system.rows.measurement.groups
        nothing = np.zeros((0, len(self.system.free) + 1))
        unknown, known = ({group.name: nothing for group in groups} for _ in range(2))
        for own, rows in self.system.rows.pieces():
            linear, counts = rows.at(x), rows.seen & (weights[own] > 0)
            root = np.sqrt(np.where(counts, weights[own], 1.0))
            told = counts & np.isfinite(self.known[own])
            for group in groups:
                columns = list(group.columns)
                for out, mask, sigma in ((unknown, counts & ~told, 1.0), (known, told, self.known[own])):
                    if mask[:, columns].any():
                        spread = np.full(counts.shape, np.inf)
                        spread[:, columns] = np.where(mask, sigma / root, np.inf)[:, columns]
                        out[group.name] = appended(out[group.name], self.system.picked(linear, spread))
        return Groups(unknown, known)
