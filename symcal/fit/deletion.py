r"""What an estimate would be without one of its readings, and readings that are no accident at the noise of the others.

With the whitened rows [J_b r_b] of a reading b of d components and A of everything,

    H_b = J_b A^-1 J_b^T,   y_-b - y = A^-1 J_b^T (I - H_b)^-1 r_b,   e_b = (I - H_b)^-1 r_b:

y_-b is the least-squares solution of all other rows, e_b how far the reading lies from where they put it: exact for the
linearised model, the variances held ([Cook1982] sec. 3.4). With T_b = r_b^T e_b the test of a reading is

    T_b / d / s_-b^2 ~ F(d, nu - d),    s_-b^2 = (sum r^2 - T_b) / (nu - d),

the externally studentised residual; chi-squared where the noise is known. Several slips hide each other: the furthest
are set aside and the rest judged again until nothing changes. A reading that is set aside is judged by the same law
with e_b = r_b and T_b = r_b^T (I + H_b)^-1 r_b. Setting aside in turn is ours.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.fit.residual_rows import Rows
from symcal.fit.robust import Loss
from symcal.fit.whitened import Whitened
from symcal.model.measurement import Group
from symcal.solvers.appended import appended

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHANCE = 0.01
"""Probability that a set of good readings has one that is called an outlier."""
_ROUNDS = 200
_MOST = 0.5  # share of the readings of a group that may be set aside
_FURTHEST = 0.5  # of the furthest one's test: these are set aside together
_SURELY_GOOD = 0.99  # of the norm of normal noise: readings a robust fit's good ones are first taken from
_SETTLED = 1e-6


@dataclass(frozen=True, slots=True)
class Pile:
    """The readings of a noise group, K of them, pose by pose.

    r: shape (K, d), mm, rad or px, zero where nothing was measured. seen: shape (K, d). known: standard deviations,
    shape (K, d), NaN where unknown. pose, place: of each reading, and which of its pose it is.
    """

    group: Group
    r: Array
    seen: Mask
    known: Array
    pose: NDArray[np.intp]
    place: NDArray[np.intp]

    @property
    def there(self) -> Mask:
        """Readings of which anything was measured, shape (K,)."""
        return np.asarray(self.seen.any(axis=1))

    @property
    def size(self) -> NDArray[np.intp]:
        """Components of each reading, shape (K,)."""
        return np.asarray(self.seen.sum(axis=1))

    def inverse(self, sigma: float) -> Array:
        """What whitens the components, zero where nothing was measured, (K, d). Args: sigma: where none is known."""
        spread = np.where(np.isfinite(self.known), self.known, sigma)
        return np.where(self.seen, 1 / spread, 0.0)

    def white(self, sigma: float) -> Array:
        """Whitened residuals, shape (K, d). Args: sigma: where none is known."""
        return self.r * self.inverse(sigma)


Piece = tuple[tuple[slice, Array], ...]
"""By noise group, which readings, and their rows [J S, r], shape (k, d, n + 1), mm, rad or px."""


@dataclass(frozen=True, slots=True)
class Readings:
    """Everything that was read, at x, by noise group; made by `readings_at`.

    held: the rows of every group, shape (K, d, n + 1), where they are few enough to be kept.
    """

    system: Whitened
    x: Array
    piles: tuple[Pile, ...]
    held: tuple[Array, ...] | None

    def pieces(self) -> Iterator[Piece]:
        """All rows, those of a few thousand components at a time where they are not held."""
        if self.held is not None:
            yield tuple((slice(0, len(rows)), rows) for rows in self.held)
            return
        for own, rows in self.system.rows.pieces():
            both = _side_by_side(self.system, rows, self.x)
            yield tuple(
                (slice(own.start * each, own.stop * each), _of_group(both, pile.group))
                for pile in self.piles
                for each in (len(pile.group.columns) // pile.group.block,)
            )

    def white(self, sigmas: Mapping[str, float]) -> list[Array]:
        """Whitened rows of every group, which must be held, shape (K, d, n + 1). Args: sigmas: where none is known."""
        assert self.held is not None
        return [
            rows * pile.inverse(sigmas[pile.group.name])[:, :, None]
            for pile, rows in zip(self.piles, self.held, strict=True)
        ]

    def rows(self, number: int, i: int) -> Array:
        """Of one reading of the pile of this number, shape (d, n + 1)."""
        if self.held is not None:
            return np.asarray(self.held[number][i])
        pile = self.piles[number]
        pose = int(pile.pose[i])
        alone = self.system.rows.take(slice(pose, pose + 1))
        return np.asarray(_of_group(_side_by_side(self.system, alone, self.x), pile.group)[pile.place[i]])


@dataclass(frozen=True, slots=True)
class Judged:
    """Readings of a group, judged by the others.

    off: e, shape (K, d), mm, rad or px. sigma: the noise of the others. test: T / (d s^2), shape (K,); zero where
    nothing was measured. bad: whether chance does not explain it. scale: rms of the good ones over their noise, with
    what was learnt from them taken off. y: the estimate by the good ones of all groups, from where the rows are, (n,).
    """

    off: Array
    sigma: float
    test: Array
    bad: Mask
    scale: float
    y: Array


def readings_at(system: Whitened, x: Array, known: Array, *, hold: bool | None = None) -> Readings:
    """The readings at x by noise group, of those groups that have any.

    Args:
        known: standard deviations, shape (N, m), NaN where unknown. hold: whether all rows are kept; if they are not
            very many when None.
    """
    rows = system.rows
    both = _side_by_side(system, rows, x) if (not rows.many if hold is None else hold) else None
    r = rows.residual(x) if both is None else both[:, :, -1]
    found, held = [], []
    for group in rows.measurement.groups:
        columns = list(group.columns)
        each = len(columns) // group.block
        shape = (len(r) * each, group.block)
        seen = rows.seen[:, columns].reshape(shape)
        if not seen.any():
            continue
        found.append(
            Pile(
                group,
                r[:, columns].reshape(shape),
                seen,
                known[:, columns].reshape(shape),
                np.repeat(np.arange(len(r)), each),
                np.tile(np.arange(each), len(r)),
            )
        )
        if both is not None:
            held.append(_of_group(both, group))
    return Readings(system, x, tuple(found), None if both is None else tuple(held))


def _side_by_side(system: Whitened, rows: Rows, x: Array) -> Array:
    """[J S, r] of every component, shape (N, m, n + 1)."""
    r, jacobian = rows(x)
    out = np.empty((*r.shape, len(system.index) + 1))
    np.multiply(jacobian[:, :, system.index], system.scales, out=out[:, :, :-1])
    out[:, :, -1] = r
    return out


def _of_group(both: Array, group: Group) -> Array:
    """The same by reading, shape (K, d, n + 1)."""
    return both[:, list(group.columns)].reshape(-1, group.block, both.shape[2])


def without(stacked: Array, own: Array) -> Array:
    """y_-b - y, shape (n,): the least-squares solution without the rows ``own``, less that with them.

    Args:
        stacked: all whitened [J r] at their minimum, shape (k, n + 1), ``own`` among them. own: shape (d, n + 1).
    """
    triangle: Array = np.asarray(np.linalg.qr(stacked[:, :-1], mode="r"), dtype=np.float64)
    half = scipy.linalg.solve_triangular(triangle, own[:, :-1].T, trans="T")  # R^-T J_b^T
    left = np.eye(len(own)) - half.T @ half
    return np.asarray(scipy.linalg.solve_triangular(triangle, half @ np.linalg.solve(left, own[:, -1])))


def judged(given: Readings, known: Array, sigmas: dict[str, float], loss: Loss) -> tuple[Judged, ...]:
    """Every reading judged by the good ones, by noise group.

    Args:
        known: whitened rows of all that is known beforehand, shape (k, n + 1). sigmas: noise by group to begin with.
        loss: with the linear one all are good to begin with, with a robust one those near to the estimate.
    """
    piles = given.piles
    count = sum(int(pile.there.sum()) for pile in piles)
    good = [pile.there & (_near(pile, sigmas[pile.group.name]) | (loss == "linear")) for pile in piles]
    sigmas, before = dict(sigmas), set[bytes]()
    for _ in range(_ROUNDS):
        found = _by_good(given, known, sigmas, good, CHANCE / max(count, 1))
        settled = all(abs(j.sigma / sigmas[p.group.name] - 1) < _SETTLED for p, j in zip(piles, found, strict=True))
        sigmas = {pile.group.name: j.sigma for pile, j in zip(piles, found, strict=True)}
        last, good = good, [_next(p, j, g) for p, j, g in zip(piles, found, good, strict=True)]
        same = all(np.array_equal(a, b) for a, b in zip(last, good, strict=True))
        key = b"".join(g.tobytes() for g in good)
        if (same and settled) or (not same and key in before):
            break
        before.add(key)
    return found


def _near(pile: Pile, sigma: float) -> Mask:
    """Readings that are as near to the estimate as nearly all good ones."""
    square = np.sum(pile.white(sigma) ** 2, axis=1)
    return np.asarray(square <= 2 * scipy.special.gammaincinv(np.maximum(pile.size, 1) / 2, _SURELY_GOOD))


def _next(pile: Pile, found: Judged, good: Mask) -> Mask:
    """The good readings of the next round: those set aside that chance explains are good again."""
    bad_of_good = good & found.bad
    if not bad_of_good.any():
        return pile.there & ~found.bad
    furthest = float(found.test[bad_of_good].max())
    kept = good & ~(bad_of_good & (found.test >= _FURTHEST * furthest))
    return kept if kept.sum() >= _MOST * pile.there.sum() else good


def _by_good(
    given: Readings, known: Array, sigmas: dict[str, float], good: list[Mask], chance: float
) -> tuple[Judged, ...]:
    """One round: the estimate of the good readings at these sigmas, and every reading beside it."""
    inverse = [pile.inverse(sigmas[pile.group.name]) for pile in given.piles]
    root, y = _estimate(given, known, inverse, good)
    beside = [_Beside.nothing(pile) for pile in given.piles]
    for piece in given.pieces():
        for (own, rows), scale, among, out in zip(piece, inverse, good, beside, strict=True):
            out.fill(own, rows * scale[own, :, None], root, y, among[own])
    return tuple(
        _judged(pile, found, sigmas[pile.group.name], own, y, chance)
        for pile, found, own in zip(given.piles, beside, good, strict=True)
    )


def _estimate(given: Readings, known: Array, inverse: list[Array], good: list[Mask]) -> tuple[Array, Array]:
    """R^-1 of the whitened rows of the good readings and what is known, shape (n, n), and their minimiser, (n,)."""
    width = known.shape[1]
    stacked = np.zeros((0, width))
    for piece in given.pieces():
        told = [
            (rows * scale[own, :, None])[among[own]].reshape(-1, width)
            for (own, rows), scale, among in zip(piece, inverse, good, strict=True)
        ]
        stacked = np.vstack(told) if given.held is not None else appended(stacked, np.vstack(told))
    triangle: Array = np.asarray(np.linalg.qr(np.vstack([stacked, known, np.zeros((width, width))]), mode="r"))
    root = scipy.linalg.solve_triangular(triangle[:-1, :-1], np.eye(width - 1))
    return root, -root @ triangle[:-1, -1]


@dataclass(frozen=True, slots=True)
class _Beside:
    """The readings of a pile beside an estimate, whitened, filled piece by piece.

    r: residuals, shape (K, d). hat: traces of H, shape (K,). inside: e of good readings, (I + H)^-1 r of others, shape
    (K, d).
    """

    r: Array
    hat: Array
    inside: Array

    @staticmethod
    def nothing(pile: Pile) -> _Beside:
        return _Beside(np.empty(pile.r.shape), np.empty(len(pile.r)), np.empty(pile.r.shape))

    def fill(self, own: slice, rows: Array, root: Array, y: Array, good: Mask) -> None:
        unit = np.eye(rows.shape[1])
        r, half = rows @ np.append(y, 1.0), rows[:, :, :-1] @ root
        hat = half @ half.swapaxes(1, 2)
        self.r[own], self.hat[own] = r, np.einsum("nii->n", hat)
        left = np.where(good[:, None, None], unit - hat, unit + hat)
        self.inside[own] = np.linalg.solve(left, r[:, :, None])[:, :, 0]


def _judged(pile: Pile, found: _Beside, sigma: float, own: Mask, y: Array, chance: float) -> Judged:
    r, inside = found.r, found.inside
    test = np.sum(r * inside, axis=1)
    off = np.where(own[:, None], inside, r)
    size = np.maximum(pile.size, 1)
    dof = int(pile.size[own].sum()) - float(found.hat[own].sum())
    squares = float(np.sum(r[own] ** 2))
    scale = float(np.sqrt(squares / max(dof, 1.0)))
    if np.isfinite(pile.known[pile.seen]).all():
        chances, ratio, grown = scipy.special.chdtrc(size, test), test / size, 1.0
    else:
        grown = scale
        fewer = np.where(own, dof - size, dof)
        rest = np.where(own, squares - test, squares) / np.maximum(fewer, 1.0)
        ratio = test / size / np.maximum(rest, 1e-300)
        chances = np.where(fewer > 0, scipy.special.fdtrc(size, np.maximum(fewer, 1.0), ratio), 1.0)
    new = max(sigma * grown, pile.group.floor)
    spread = np.where(np.isfinite(pile.known), pile.known, sigma)
    bad = pile.there & (chances < chance)
    return Judged(off * spread, new, np.where(pile.there, ratio, 0.0), bad, scale, y)
