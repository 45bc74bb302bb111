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

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.fit.residual_rows import Rows
from symcal.fit.robust import Loss
from symcal.fit.whitened import Whitened
from symcal.model.measurement import Group

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

    rows: [J S, r], shape (K, d, n + 1), mm, rad or px, zero where nothing was measured. seen: shape (K, d). known:
    standard deviations, shape (K, d), NaN where unknown. pose, place: of each reading, and which of its pose it is.
    """

    group: Group
    rows: Array
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

    def white(self, sigma: float, weight: Array | None = None) -> Array:
        """Whitened rows, shape (K, d, n + 1). Args: sigma: where none is known. weight: of each reading, (K,)."""
        spread = np.where(np.isfinite(self.known), self.known, sigma)
        scale = np.where(self.seen, 1 / spread, 0.0)
        if weight is not None:
            scale = scale * np.sqrt(weight)[:, None]
        return np.asarray(self.rows * scale[:, :, None])


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


def piles(system: Whitened, x: Array, known: Array) -> tuple[Pile, ...]:
    """The readings at x by noise group. Args: known: standard deviations, shape (N, m), NaN where unknown."""
    rows: Rows = system.rows
    r, jacobian = rows(x)
    both = np.concatenate([jacobian[:, :, system.index] * system.scales, r[:, :, None]], axis=2)
    out = []
    for group in rows.measurement.groups:
        columns = list(group.columns)
        each = len(columns) // group.block
        shape = (len(r) * each, group.block)
        out.append(
            Pile(
                group,
                both[:, columns].reshape(*shape, both.shape[2]),
                rows.seen[:, columns].reshape(shape),
                known[:, columns].reshape(shape),
                np.repeat(np.arange(len(r)), each),
                np.tile(np.arange(each), len(r)),
            )
        )
    return tuple(out)


def without(stacked: Array, own: Array) -> Array:
    """y_-b - y, shape (n,): the least-squares solution without the rows ``own``, less that with them.

    Args:
        stacked: all whitened [J r] at their minimum, shape (k, n + 1), ``own`` among them. own: shape (d, n + 1).
    """
    triangle: Array = np.asarray(np.linalg.qr(stacked[:, :-1], mode="r"), dtype=np.float64)
    half = scipy.linalg.solve_triangular(triangle, own[:, :-1].T, trans="T")  # R^-T J_b^T
    left = np.eye(len(own)) - half.T @ half
    return np.asarray(scipy.linalg.solve_triangular(triangle, half @ np.linalg.solve(left, own[:, -1])))


def judged(given: tuple[Pile, ...], known: Array, sigmas: dict[str, float], loss: Loss) -> tuple[Judged, ...]:
    """Every reading judged by the good ones.

    Args:
        known: whitened rows of all that is known beforehand, shape (k, n + 1). sigmas: noise by group to begin with.
        loss: with the linear one all are good to begin with, with a robust one those near to the estimate.
    """
    count = sum(int(pile.there.sum()) for pile in given)
    good = [pile.there & (_near(pile, sigmas[pile.group.name]) | (loss == "linear")) for pile in given]
    sigmas, before = dict(sigmas), set[bytes]()
    for _ in range(_ROUNDS):
        found = _by_good(given, known, sigmas, good, CHANCE / max(count, 1))
        settled = all(abs(j.sigma / sigmas[p.group.name] - 1) < _SETTLED for p, j in zip(given, found, strict=True))
        sigmas = {pile.group.name: j.sigma for pile, j in zip(given, found, strict=True)}
        last, good = good, [_next(p, j, g) for p, j, g in zip(given, found, good, strict=True)]
        same = all(np.array_equal(a, b) for a, b in zip(last, good, strict=True))
        key = b"".join(g.tobytes() for g in good)
        if (same and settled) or (not same and key in before):
            break
        before.add(key)
    return found


def _near(pile: Pile, sigma: float) -> Mask:
    """Readings that are as near to the estimate as nearly all good ones."""
    square = np.sum(pile.white(sigma)[:, :, -1] ** 2, axis=1)
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
    given: tuple[Pile, ...], known: Array, sigmas: dict[str, float], good: list[Mask], chance: float
) -> tuple[Judged, ...]:
    """One round: the estimate of the good readings at these sigmas, and every reading beside it."""
    white = [pile.white(sigmas[pile.group.name]) for pile in given]
    width = known.shape[1]
    stacked = np.vstack([*(w[g].reshape(-1, width) for w, g in zip(white, good, strict=True)), known])
    triangle: Array = np.asarray(np.linalg.qr(np.vstack([stacked, np.zeros((width, width))]), mode="r"))
    root = scipy.linalg.solve_triangular(triangle[:-1, :-1], np.eye(width - 1))
    y = np.append(-root @ triangle[:-1, -1], 1.0)
    out = []
    for pile, rows, own in zip(given, white, good, strict=True):
        sigma, unit = sigmas[pile.group.name], np.eye(pile.group.block)
        r, half = rows @ y, rows[:, :, :-1] @ root
        hat = half @ half.swapaxes(1, 2)
        inside = np.linalg.solve(np.where(own[:, None, None], unit - hat, unit + hat), r[:, :, None])[:, :, 0]
        test = np.sum(r * inside, axis=1)
        off = np.where(own[:, None], inside, r)
        size = np.maximum(pile.size, 1)
        dof = int(pile.size[own].sum()) - float(np.einsum("nii->n", hat)[own].sum())
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
        out.append(Judged(off * spread, new, np.where(pile.there, ratio, 0.0), bad, scale, y[:-1]))
    return tuple(out)
