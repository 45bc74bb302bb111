"""The rows of a fit in scaled unknowns y, x = x_ref + S y: measurements, stated priors, plausible sizes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.fit.residual_rows import Linear, Rows
from symcal.model.measurement import Measurement
from symcal.parameters import ParameterSet
from symcal.solvers.appended import appended

Array = NDArray[np.float64]

FREEDOM = 1e3
"""Frames, points and camera have a prior of so many of their scales (1 m and 10 rad by default): they are nearly free,
and what they share unseen with a link parameter is theirs."""

LINKS = ""
"""The group of the link parameters."""


@dataclass(frozen=True, slots=True)
class Beforehand:
    """What is known of the free parameters before anything is measured.

    stated: whitened rows of stated priors by the free parameters (mm, rad, px), shape (k, n). sized, nearly_free: which
    have a plausible size as their prior instead, and which a very wide one, shape (n,). assumed: standard deviations,
    shape (n,).
    """

    stated: Array
    sized: NDArray[np.bool_]
    nearly_free: NDArray[np.bool_]
    assumed: Array

    def rows(self, scales: Array) -> Array:
        """The same as whitened rows by y = S^-1 x, sizes as stated, shape (k, n)."""
        own = np.diag(self.sized + self.nearly_free / FREEDOM)
        return np.vstack([self.stated * scales, own[self.sized | self.nearly_free]])


def beforehand(parameters: ParameterSet, free: tuple[str, ...]) -> Beforehand:
    """Stated priors where there are any, else plausible sizes of link parameters and next to nothing of frames."""
    index = parameters.indices(free)
    stated = parameters.prior_rows(free)
    told = np.asarray(stated.any(axis=0))
    wide = np.array([parameters.items[i].unknown for i in index], dtype=np.bool_) & ~told
    scales = parameters.scales[index]
    assumed = np.where(wide, FREEDOM * scales, scales)
    if told.any():
        assumed[told] = np.linalg.norm(np.linalg.inv(stated[:, told]), axis=1)
    return Beforehand(stated, ~wide & ~told, wide, assumed)


@dataclass(frozen=True, slots=True)
class Whitened:
    """What does not change during a fit.

    index: the n free parameters in the vector. scales: diagonal of S, shape (n,). before: what is known of them
    beforehand, without the common factor. prior_mean: where stated priors are centred. groups: which parameters share a
    factor on their sizes, by name, as a mask of the free ones; links are called `LINKS`.
    """

    rows: Rows
    free: tuple[str, ...]
    reference: Array
    index: NDArray[np.intp]
    scales: Array
    before: Beforehand
    prior_mean: Array
    growth: Array
    across: Array
    groups: Mapping[str, NDArray[np.bool_]]

    def at(self, y: Array) -> Array:
        """x_ref + S y, shape of the whole vector."""
        x = self.reference.copy()
        x[self.index] += self.scales * y
        return x

    def scaled(self, x: Array) -> Array:
        """y of x."""
        return np.asarray((x - self.reference)[self.index] / self.scales)

    def data_rows(self, x: Array, spread: Array) -> Array:
        """Whitened [J S, r] of the measurements, shape (k, n + 1); of very many their triangle, piece by piece."""
        if not self.rows.many:
            return self.picked(self.rows.at(x), spread)
        out = np.zeros((0, len(self.free) + 1))
        for own, rows in self.rows.pieces():
            out = appended(out, self.picked(rows.at(x), spread[own]))
        return out

    def rows_at(self, x: Array, spread: Array, factors: Mapping[str, float]) -> Array:
        """Whitened [J S, r] of everything, shape (k, n + 1).

        Args:
            factors: on the sizes, by group.
        """
        return np.vstack([self.data_rows(x, spread), self.known_rows(x, factors)])

    def known_rows(self, x: Array, factors: Mapping[str, float]) -> Array:
        """Whitened rows of all that is known without the measurements, shape (k, n + 1)."""
        sizes = [self.size_rows(x, group) / factors[group] for group in self.groups]
        return np.vstack([self.prior_rows(x), *sizes])

    def factors(self, factors: Mapping[str, float]) -> Array:
        """Those of every free parameter, shape (n,); 1 of those without a size."""
        out = np.ones(len(self.free))
        for group, own in self.groups.items():
            out[own] = factors[group]
        return out

    def prior_rows(self, x: Array) -> Array:
        """Rows of stated priors and known values, of the wide ones of frames, and of the growth, shape (k, n + 1)."""
        prior = self.before.stated
        stated = np.column_stack([prior * self.scales, prior @ (x - self.prior_mean)[self.index]])
        wide = np.flatnonzero(self.before.nearly_free)
        held = self.growth @ self._unit_rows(np.flatnonzero(self.groups[LINKS]), x)
        return np.vstack([stated, self.value_rows(x), self._unit_rows(wide, x) / FREEDOM, held])

    def value_rows(self, x: Array) -> Array:
        """Rows of known values, shape (k, n + 1)."""
        r, jacobian = self.rows.values(x)
        return np.column_stack([jacobian[:, self.index] * self.scales, r])

    def size_rows(self, x: Array, group: str) -> Array:
        """Rows of the plausible sizes of a group as they are stated, shape (k, n + 1); without that of the growth of
        all lengths where nothing that is read sees it: no common factor may release it."""
        sizes = self._unit_rows(np.flatnonzero(self.groups[group]), x)
        return self.across @ sizes if group == LINKS and len(self.growth) else sizes

    def _unit_rows(self, which: NDArray[np.intp], x: Array) -> Array:
        rows = np.zeros((len(which), len(self.free) + 1))
        rows[np.arange(len(which)), which] = 1.0
        rows[:, -1] = self.scaled(x)[which]
        return rows

    def picked(self, linear: Linear, spread: Array) -> Array:
        """Whitened [J S, r] of the components of finite ``spread``, shape (k, n + 1), see `Linear.weighted`."""
        return linear.weighted(spread, self.index, self.scales)


def whitened(rows: Rows, free: tuple[str, ...], reference: Array, prior_mean: Array) -> Whitened:
    """The system of the free parameters; the others stay at ``reference``."""
    parameters = rows.measurement.parameters
    index = parameters.indices(free)
    before = beforehand(parameters, free)
    names = np.array([parameters.items[i].group for i in index], dtype=object)
    found = dict.fromkeys([LINKS, *names[before.sized].tolist()])
    groups = {name: np.asarray(before.sized & (names == name)) for name in found}
    growth, across = _growth(rows.measurement, index[groups[LINKS]])
    return Whitened(
        rows=rows,
        free=free,
        reference=reference,
        index=index,
        scales=parameters.scales[index],
        before=before,
        prior_mean=prior_mean,
        growth=growth,
        across=across,
        groups=groups,
    )


def _growth(measurement: Measurement, links: NDArray[np.intp]) -> tuple[Array, Array]:
    """Direction of uniform growth among the links' sized parameters where no reading sees lengths, and those across."""
    grown = (measurement.growth * measurement.parameters.scales)[links]
    if measurement.sees_length or not grown.any():
        return np.zeros((0, grown.size)), np.eye(grown.size)
    _, _, rows = np.linalg.svd(grown[None])
    return rows[:1], rows[1:]
