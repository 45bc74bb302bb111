"""Unknown variances of a fit: noise of each group, one factor on the plausible sizes, and robust weights.

For the model linearised at an estimate they are those of largest marginal likelihood
(`symcal.fit.variance_components`). With a robust loss the noise comes from the median of the residuals instead, and the
weights with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.fit.noise import block_sigmas, robust_weights, spread_of, weighted_sigmas
from symcal.fit.residual_rows import Linear
from symcal.fit.robust import Loss
from symcal.fit.triangles import Triangles
from symcal.fit.variance_components import Block, Components, Tie, at_variances, compressed, likeliest
from symcal.fit.whitened import LINKS, Whitened
from symcal.model.measurement import Group

Array = NDArray[np.float64]

_SMALLEST_FACTOR, _LARGEST_FACTOR = 0.1, 1e3
_DOUBTFUL_FACTOR = 3.0  # largest one where few equations cannot tell large errors from what the model lacks
_MANY = 3  # equations per parameter that can
_FACTORS = (1.0, 5.0, 0.2)  # common factors of the sizes from which the first search starts
_LEFT_OVER = 0.5  # equations of a noise group that must be left to tell it by
_SMALL = 1e-3  # noise that counts as small beside residuals
_TIE_WIDTH = 2 * float(np.log(3.0))
"""Noise of positions and orientations of one instrument: alike at its lever within a factor of three (half width of a
Cauchy law), which decides only where hardly anything is left over to tell one of them by. Ours."""
NOTHING = 1e-3
"""Factor on the sizes of a group of joint terms at which the group is as good as left out."""
_LARGEST_TERM = 100.0
_FACTOR_WIDTH = 2 * np.log(1.15)
"""Stated sizes hold unless the data clearly contradict them: a Cauchy law of half width 15 % for the logarithm of their
common factor (here of the log variance). Its long tails let go of sizes that are wrong by a factor of two or more, its
middle keeps the factor from following the chance of a few parameters. Ours."""


@dataclass(frozen=True, slots=True)
class Variances:
    """sigmas: noise by group, mm, rad or px. factors: on the plausible sizes, by group (`LINKS` and those of joint
    terms). weights: robust ones, shape (N, m)."""

    sigmas: dict[str, float]
    factors: dict[str, float]
    weights: Array

    @property
    def factor(self) -> float:
        """On the sizes of the links."""
        return self.factors[LINKS]

    def towards(self, other: Variances, share: float) -> Variances:
        """A share of the way to other ones, in logarithms."""
        return Variances(
            {name: old ** (1 - share) * other.sigmas[name] ** share for name, old in self.sigmas.items()},
            {name: old ** (1 - share) * other.factors[name] ** share for name, old in self.factors.items()},
            self.weights + share * (other.weights - self.weights),
        )


@dataclass(frozen=True, slots=True)
class VarianceModel:
    """Which variances are unknown, and how to find them.

    known: standard deviation of each component, shape (N, m), NaN where unknown. missing: measured ones without it.
    estimated: groups with unknown noise. factors: groups whose factor on the sizes is unknown; shrinking: those of them
    that may not be there at all, so that nothing draws the factor to one.
    """

    system: Whitened
    known: Array
    missing: NDArray[np.bool_]
    estimated: tuple[str, ...]
    factors: tuple[str, ...]
    loss: Loss
    shrinking: tuple[str, ...] = ()
    hold: bool = False
    """Robust weights alone are found: the noise stays."""
    triangles: Triangles | None = None
    """In place of the rows, where these are very many."""

    @property
    def settled(self) -> bool:
        """Nothing is unknown."""
        return not self.estimated and not self.factors and self.loss == "linear"

    def difference(self, new: Variances, old: Variances) -> Array:
        """Change of the log variances that are estimated."""
        pairs = [(new.sigmas[name], old.sigmas[name]) for name in self.estimated]
        pairs += [(new.factors[name], old.factors[name]) for name in self.factors]
        return 2 * np.array([np.log(a / b) for a, b in pairs])

    def spread(self, variances: Variances) -> Array:
        """Standard deviation that whitens each component, shape (N, m); infinite where it does not count."""
        return spread_of(self.system.rows, self.known, variances.sigmas, variances.weights)

    def finite(self, x: Array) -> bool:
        """Whether the model gives finite numbers at x."""
        if self.triangles is None:
            return bool(np.isfinite(self.system.rows.residual(x)).all())
        found = self.triangles.at(x, self.system.rows.seen.astype(float))
        return all(np.isfinite(each).all() for each in (*found.unknown.values(), *found.known.values()))

    def rows_with(self, variances: Variances) -> Callable[[Array], Array]:
        """x -> whitened [J S, r] of everything, shape (k, n + 1)."""
        own, factors = self.data_rows_with(variances), variances.factors
        return lambda x: np.vstack([own(x), self.system.known_rows(x, factors)])

    def data_rows_with(self, variances: Variances) -> Callable[[Array], Array]:
        """x -> whitened [J S, r] of the measurements, shape (k, n + 1); the triangles of very many."""
        if self.triangles is not None:
            at, weights, sigmas = self.triangles.at, variances.weights, variances.sigmas
            return lambda x: np.vstack([*at(x, weights).whitened(sigmas).values()])
        spread = self.spread(variances)
        return lambda x: self.system.data_rows(x, spread)

    def group_rows(self, x: Array, variances: Variances) -> dict[str, Array]:
        """Whitened [J S, r] of every noise group alone, shape (k, n + 1) each."""
        if self.triangles is not None:
            return self.triangles.at(x, variances.weights).whitened(variances.sigmas)
        out, spread = {}, self.spread(variances)
        for group in self.system.rows.measurement.groups:
            own = np.full_like(spread, np.inf)
            own[:, list(group.columns)] = spread[:, list(group.columns)]
            out[group.name] = self.system.data_rows(x, own)
        return out

    def first(self, x: Array, stated: dict[str, float], tolerance: float) -> Variances:
        """Variances for the model linearised at x when nothing is known of them, without robust weights."""
        one = dict.fromkeys(self.system.groups, 1.0)
        sigmas = stated | dict.fromkeys(self.estimated, np.nan)
        variances = Variances(sigmas, one, self.system.rows.seen.astype(float))
        names, blocks, fixed = self._blocks(x, variances, self.estimated)
        starts = [self._start(names, blocks, fixed, f) for f in (_FACTORS if LINKS in self.factors else (1.0,))]
        ties = self.ties(names)
        start = min(starts, key=lambda phi: at_variances(blocks, fixed, phi, ties).value) if starts[1:] else starts[0]
        return self.named(names, likeliest(blocks, fixed, start, ties, tolerance=tolerance), variances)

    def next(self, x: Array, last: Variances, tolerance: float) -> Variances:
        """Variances (and robust weights) for the model linearised at x, from the last ones."""
        robust = self.loss != "linear"
        if robust:
            last = self._robust(x, last)
        names, blocks, fixed = self._blocks(x, last, () if robust else self.estimated)
        phi = likeliest(blocks, fixed, self.phi(names, last), self.ties(names), tolerance=tolerance)
        return self.named(names, phi, last)

    def at(self, x: Array, variances: Variances) -> tuple[Components, tuple[Block, ...]]:
        """The model linearised at x, its variances as they are.

        Raises:
            RefusedError: the model passes through the measurements, and no residual tells their noise.
        """
        names, blocks, fixed = self.linearised(x, variances)
        found = at_variances(blocks, fixed, self.phi(names, variances), self.ties(names))
        for name, taken in self._taken(names, blocks, found).items():
            columns = list(self._group(name).columns)
            if float(variances.weights[:, columns][self.missing[:, columns]].sum()) - taken < _LEFT_OVER:
                raise RefusedError(
                    f"{len(self.system.rows.data)} poses leave nothing to tell the noise of the {name} by: the model "
                    "passes through all of it; measure more poses (three times as many are sensible), state the noise, "
                    "or hold parameters with 'fix'"
                )
        return found, tuple(blocks)

    def linearised(self, x: Array, variances: Variances) -> tuple[list[str], list[Block], Array]:
        """Names and blocks of unknown variance for the model linearised at x, and the rows of known variance."""
        return self._blocks(x, variances, self.estimated)

    def _taken(self, names: list[str], blocks: list[Block], found: Components) -> dict[str, float]:
        """By noise group, the trace of its own projection: how many of its equations the parameters have taken."""
        return {
            name: float(np.sum((block.rows[:, :-1] @ found.root) ** 2)) * float(np.exp(-phi))
            for name, block, phi in zip(names, blocks, found.phi, strict=True)
            if name in self.estimated
        }

    def ties(self, names: list[str]) -> tuple[Tie, ...]:
        """Noise of the groups of one instrument goes together: one of them alone cannot fall to nothing."""
        first: dict[str, int] = {}
        ties = []
        for i, name in enumerate(names):
            if name not in self.estimated:
                continue
            group = self._group(name)
            lead = first.setdefault(group.observation, i)
            if lead != i:
                offset = 2 * float(np.log(group.alike / self._group(names[lead]).alike))
                ties.append(Tie(lead, i, offset, _TIE_WIDTH))
        return tuple(ties)

    def _group(self, name: str) -> Group:
        return next(g for g in self.system.rows.measurement.groups if g.name == name)

    def from_what_counts(self, x: Array, variances: Variances) -> Variances:
        """The noise from the readings that count, by their weights."""
        found, blocks = self.at(x, variances)
        names = [*self.estimated, *map(size_name, self.factors)]
        taken = self._taken(names, list(blocks), found)
        rows = self.system.rows
        own = weighted_sigmas(rows, rows.residual(x), self.missing, variances.weights, taken, self.loss)
        return replace(variances, sigmas=variances.sigmas | own)

    def _robust(self, x: Array, variances: Variances) -> Variances:
        """Noise from the median of the residuals, then the weights that go with it."""
        rows = self.system.rows
        residual = rows.residual(x)
        sigmas = variances.sigmas
        if not self.hold:
            found, blocks = self.at(x, variances)
            names = [*self.estimated, *map(size_name, self.factors)]
            taken = self._taken(names, list(blocks), found)
            sigmas = sigmas | block_sigmas(rows, residual, self.missing, taken)
        return replace(variances, sigmas=sigmas, weights=robust_weights(rows, residual, self.known, sigmas, self.loss))

    def _blocks(self, x: Array, variances: Variances, groups: tuple[str, ...]) -> tuple[list[str], list[Block], Array]:
        """Names and blocks of unknown variance, the noise of ``groups`` among them, and the rows of known variance."""
        system = self.system
        blocks, data = self._noise_blocks(x, variances, groups)
        fixed = np.vstack([data, system.prior_rows(x)])
        for group in system.groups:
            sizes = system.size_rows(x, group)
            if group not in self.factors:
                fixed = np.vstack([fixed, sizes / variances.factors[group]])
            elif group in self.shrinking:
                blocks.append(Block(sizes, len(sizes), 2 * np.log(NOTHING), 2 * np.log(_LARGEST_TERM)))
            else:
                many = int(system.rows.seen.sum()) >= _MANY * len(system.free)
                largest = 2 * np.log(_LARGEST_FACTOR if many else _DOUBTFUL_FACTOR)
                blocks.append(Block(sizes, len(sizes), 2 * np.log(_SMALLEST_FACTOR), largest, _FACTOR_WIDTH))
        return [*groups, *map(size_name, self.factors)], blocks, compressed(fixed)

    def _noise_blocks(self, x: Array, variances: Variances, groups: tuple[str, ...]) -> tuple[list[Block], Array]:
        """The blocks of groups of unknown noise, and the rows of all other measurements, whitened."""
        weights, system = variances.weights, self.system
        sigmas = {name: sigma for name, sigma in variances.sigmas.items() if name not in groups}
        masks = {name: self._unknown(name, weights) for name in groups}
        if self.triangles is not None:
            found = self.triangles.at(x, weights)
            unknown = dict(found.unknown)
            data = np.vstack([*found.whitened(sigmas).values()])
        else:
            linear = system.rows.at(x)
            unknown = {name: compressed(self._at_unit_noise(linear, masks[name], weights)) for name in groups}
            data = system.picked(linear, spread_of(system.rows, self.known, sigmas, weights))
        blocks = [
            Block(unknown[name], int(masks[name].sum()), 2 * np.log(self._group(name).floor), np.inf) for name in groups
        ]
        return blocks, data

    def _unknown(self, name: str, weights: Array) -> NDArray[np.bool_]:
        """Components of unknown noise of a group that count, shape (N, m)."""
        columns = list(self._group(name).columns)
        mask = np.zeros_like(self.missing)
        mask[:, columns] = self.missing[:, columns] & (weights[:, columns] > 0)
        return mask

    def _at_unit_noise(self, linear: Linear, mask: NDArray[np.bool_], weights: Array) -> Array:
        return self.system.picked(linear, np.where(mask, 1 / np.sqrt(np.where(mask, weights, 1.0)), np.inf))

    def _start(self, names: list[str], blocks: list[Block], fixed: Array, factor: float) -> Array:
        """Log variances for this factor with the noise that is left where noise counts as small."""
        rows = []
        given = {size_name(group): factor if group == LINKS else 1.0 for group in self.factors}
        for name, block in zip(names, blocks, strict=True):
            size = np.linalg.norm(block.rows[:, -1]) / np.sqrt(block.count)
            rows.append(block.rows / given.get(name, max(_SMALL * float(size), 1e-150)))
        stacked = np.vstack([*rows, fixed])
        y = np.linalg.lstsq(stacked[:, :-1], -stacked[:, -1], rcond=None)[0]
        left = [float(np.sum((block.rows @ np.append(y, 1.0)) ** 2)) for block in blocks]
        return np.array(
            [
                2 * np.log(given[name]) if name in given else np.log(max(square, 1e-300) / block.count)
                for name, block, square in zip(names, blocks, left, strict=True)
            ]
        )

    def phi(self, names: list[str], variances: Variances) -> Array:
        """Log variances by name."""
        values = variances.sigmas | {size_name(group): variances.factors[group] for group in self.factors}
        return np.asarray(2 * np.log(np.array([values[name] for name in names])))

    def named(self, names: list[str], phi: Array, last: Variances) -> Variances:
        """Variances from the log variances of a model."""
        values = dict(zip(names, np.exp(0.5 * phi).tolist(), strict=True))
        factors = {group: values.pop(size_name(group)) for group in self.factors}
        return Variances(last.sigmas | values, last.factors | factors, last.weights)


def size_name(group: str) -> str:
    """What the variance of a group's sizes is called beside those of the noise."""
    return f"sizes of {group or 'links'}"
