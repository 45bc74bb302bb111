"""Whether views of a board and joint readings belong together: camera and flange must move alike.

With the camera in the hand T_board_camera = B flange X for every view, with the board on the robot T_camera_board =
B flange X; B and X are the same for all, and nobody knows them. They are found in closed form (`registration.hand_eye`)
from few views at a time; those that most views agree with stand, so that views with foreign joint readings spoil
nothing. The consensus search is ours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal import spatial
from symcal.camera.board_pose import LEVER
from symcal.placing.registration import hand_eye

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mount = Literal["hand", "world"]

FEWEST = 6
"""Views from which it can be told that one of them does not belong."""
MOUNTS: tuple[Mount, ...] = ("hand", "world")

_DRAWS = 300
_DRAWN = 4  # views that B and X are found from, at a time
_SHIFTS = (1, -1, 2, -2)  # postures by which all names may be shifted
_AGREEING = 0.4  # share of the views that must agree: the rest may be foreign
_BEST = 4  # first guesses that are refined
_NEAR = 0.15  # of the misfit of foreign views: robots do not err that much
_WITHIN = 3.0  # of the scatter of those that agree: others are taken along
_ROUNDS = 15
_WORTH = 0.5  # a shift, or another size of the board, must bring doubt or scatter down to this share
_DOUBTED = 0.3  # doubt from which shifts are tried
_TURNED = 0.1  # rad: least spread of the flange's turns about a second axis
_SCALE, _SCALE_SIGMAS = 0.03, 6.0  # least difference of the board's size that is told, and in standard deviations

_LENGTH = 10.0  # mm: rms of the robot's own motion from which a size can be told
_TOLD = 0.2  # of that: the most that may be left
_ODD = 5.0  # a board is not so many times as large


@dataclass(frozen=True, slots=True)
class Agreement:
    """What most views agree on.

    mount: what the camera is on. base, tool: B and X, shape (4, 4), mm. shift: postures by which the names that agree
    are shifted. scale: of the board, as the robot's motion has it; 1 where it agrees with what is said.
    misfit: of every view at every posture, shape (N, M), mm: rms distance of the board's middle and three points at
    `LEVER` from it between where the view sees them and where the posture puts them. which: of the poses that a view
    may be, the one nearest to its own posture, shape (N,). typical: median misfit of the views that agree, mm.
    by_chance: that of all views at all postures, mm.
    """

    mount: Mount
    base: Array
    tool: Array
    shift: int
    scale: float
    misfit: Array
    which: Index
    typical: float
    by_chance: float


def agreement(
    flange: Array, own: Index, views: Array, centre: Array, rng: np.random.Generator, mounts: tuple[Mount, ...] = MOUNTS
) -> Agreement | None:
    """What most views agree on; None from fewer than `FEWEST`, or where the flange turns about one axis only.

    Args:
        flange: T_base_flange of every posture by the nominal robot, shape (M, 4, 4), mm. own: posture of each view by
            its name, shape (N,). views: T_camera_board, shape (N, k, 4, 4): up to k poses of which each is one, NaN
            for none. centre: the board's middle in its frame, shape (3,), mm. rng: draws the views. mounts: what the
            camera may be on.
    """
    if len(own) < FEWEST or not _turns_about_two(flange[own]):
        return None
    found, doubt = _best(flange, own, views, centre, rng, mounts, 0), _doubt(own)
    if found is not None and doubt(found) > _DOUBTED:
        for shift in _SHIFTS:
            shifted = _best(flange, own, views, centre, rng, mounts, shift)
            if shifted is not None and doubt(shifted) < _WORTH * doubt(found):
                found = shifted
    return None if found is None else _with_scale(found, flange, own, views, centre, rng)


def _turns_about_two(flange: Array) -> bool:
    """Whether the flange turns about more than one axis: about one alone, hand and eye cannot be told apart."""
    turns = scipy.spatial.transform.Rotation.from_matrix(flange[0, :3, :3].T @ flange[1:, :3, :3]).as_rotvec()
    return bool(np.linalg.svd(turns, compute_uv=False)[1] > _TURNED * np.sqrt(len(turns)))


def _best(
    flange: Array,
    own: Index,
    views: Array,
    centre: Array,
    rng: np.random.Generator,
    mounts: tuple[Mount, ...],
    shift: int,
) -> Agreement | None:
    found = [_consensus(flange, own, views, centre, rng, mount, shift) for mount in mounts]
    return min((each for each in found if each is not None), key=_doubt(own), default=None)


def _doubt(own: Index) -> Callable[[Agreement], float]:
    """How little the views agree, 0 to 1: the mean misfit in terms of what robots do not err, no view counting more."""

    def doubt(found: Agreement) -> float:
        at = own + found.shift
        there = np.flatnonzero((at >= 0) & (at < found.misfit.shape[1]))
        return float(np.minimum(found.misfit[there, at[there]] / (_NEAR * found.by_chance), 1.0).mean())

    return doubt


def _consensus(
    flange: Array, own: Index, views: Array, centre: Array, rng: np.random.Generator, mount: Mount, shift: int
) -> Agreement | None:
    at = own + shift
    there = np.flatnonzero((at >= 0) & (at < len(flange)))
    if len(there) < FEWEST:
        return None
    count = max(int(np.ceil(_AGREEING * len(there))), FEWEST)
    postures, seen = flange[at[there]], views[there]
    drawn = np.argsort(rng.random((_DRAWS, len(there))), axis=1)[:, :_DRAWN]
    choices = np.isfinite(seen[:, :, 0, 0]).sum(axis=1)
    which = (rng.random(drawn.shape) * choices[drawn]).astype(int)
    base, tool = hand_eye(postures[drawn], _turned(seen[drawn, which], mount))
    misfit = _each(seen, _turned(base[:, None] @ postures @ tool[:, None], mount), centre).min(axis=-1)
    some = int(np.argmin(np.sort(misfit, axis=1)[:, count - 1]))
    predicted = _turned(base[some] @ postures @ tool[some], mount)
    near = _NEAR * float(np.median(_each(seen[:, None], predicted[None], centre).min(axis=-1)))
    first = np.argsort(np.minimum(misfit, near).mean(axis=1))[:_BEST]
    refined = [_refined(postures, seen, centre, mount, base[i], tool[i], count, near) for i in first]
    b, x, misfit = min(refined, key=lambda found: float(np.minimum(found[2], near).mean()))
    typical = float(np.median(misfit[misfit <= _limit(misfit, count)]))
    return _judged(Agreement(mount, b, x, shift, 1.0, misfit, there, typical, np.nan), flange, own, views, centre)


def _judged(found: Agreement, flange: Array, own: Index, views: Array, centre: Array) -> Agreement:
    """With the misfits of all views at all postures, and the pose of each view that is nearest to its own posture."""
    each = _each(views[:, None], _turned(found.base @ flange @ found.tool, found.mount)[None], centre)
    misfit = each.min(axis=-1)
    which = np.argmin(each[np.arange(len(own)), own], axis=-1)
    return replace(found, misfit=misfit, which=which, by_chance=float(np.median(misfit)))


def _limit(misfit: Array, count: int) -> float:
    """Misfit up to which views agree, by the scatter of the best so many."""
    best = np.sort(misfit)[:count]
    return max(2 * _WITHIN * float(np.median(best)), float(best[-1]))


def _refined(
    flange: Array, views: Array, centre: Array, mount: Mount, base: Array, tool: Array, count: int, near: float
) -> tuple[Array, Array, Array]:
    """B and X of all views that agree with a first guess, and the misfit of every view, shape (N,).

    All views much nearer than foreign ones are taken along first: what agrees best may be but a corner of the area.
    """
    each = _each(views, _turned(base @ flange @ tool, mount), centre)
    kept: Index = np.zeros(0, dtype=np.intp)
    for step in range(_ROUNDS):
        misfit = each.min(axis=1)
        within = _WITHIN * float(np.median(misfit[kept])) if len(kept) else 0.0
        least = float(np.sort(misfit)[count - 1])
        again = np.flatnonzero(misfit <= max(within, least, near if step < 3 else 0.0))
        if step >= 3 and np.array_equal(again, kept):
            break
        kept = again
        chosen = np.argmin(each, axis=1)
        base, tool = hand_eye(flange[kept], _turned(views[kept, chosen[kept]], mount))
        each = _each(views, _turned(base @ flange @ tool, mount), centre)
    return base, tool, np.asarray(each.min(axis=1))


def _with_scale(
    found: Agreement, flange: Array, own: Index, views: Array, centre: Array, rng: np.random.Generator
) -> Agreement:
    """With the board's size as the robot's motion has it, where that is another one and explains the views better."""
    total, better = 1.0, found
    for _ in range(3):
        scale, sigma = _scale(better, flange, own, views, total)
        if abs(scale - 1) < max(_SCALE / 3, _SCALE_SIGMAS * sigma):
            break
        total *= scale
        grown = _sized(views, total)
        again = _consensus(flange, own, grown, centre * total, rng, found.mount, found.shift)
        if again is None:
            break
        better = again
    if abs(total - 1) < _SCALE or better.typical > _WORTH * found.typical:
        return found
    return replace(better, scale=total)


def _sized(views: Array, scale: float) -> Array:
    """The views if the board were so many times as large."""
    grown = views.copy()
    grown[..., :3, 3] *= scale
    return grown


def _scale(found: Agreement, flange: Array, own: Index, views: Array, so_far: float) -> tuple[float, float]:
    """Factor on the board's size that the translations of the views that agree ask for, and its standard deviation.

    s p_z - p_B - (R_B R_F) p_X = R_B p_F for every view, linear in s, p_B and p_X. The right side must hold lengths
    that p_B and p_X do not explain: a robot that only turns about one point has none to compare with.
    """
    at = own + found.shift
    there = np.flatnonzero((at >= 0) & (at < len(flange)))
    off = found.misfit[there, at[there]]
    there = there[off <= max(3 * _WITHIN * found.typical, _NEAR * found.by_chance)]
    if len(there) < FEWEST:
        return 1.0, np.inf
    measured = _turned(_sized(views, so_far)[there, found.which[there]], found.mount)
    turn, base = flange[at[there], :3, :3], found.base[:3, :3]
    blocks = np.concatenate([measured[:, :3, 3:], -np.broadcast_to(np.eye(3), turn.shape), -(base @ turn)], axis=2)
    moved = flange[at[there], :3, 3] @ base.T
    kept = np.arange(len(there))
    for _ in range(_ROUNDS):  # views with foreign readings are among them
        rows, right = blocks[kept].reshape(-1, 7), moved[kept].ravel()
        solution = np.linalg.lstsq(rows, right, rcond=1e-8)[0]
        miss = np.linalg.norm(blocks @ solution - moved, axis=1)
        again = np.flatnonzero(miss <= _WITHIN * np.median(miss))
        if np.array_equal(again, kept):
            break
        kept = again
    unexplained = right - rows[:, 1:] @ np.linalg.lstsq(rows[:, 1:], right, rcond=1e-8)[0]
    left = rows @ solution - right
    length, noise = float(np.sqrt(np.mean(unexplained**2))), float(np.sqrt(np.mean(left**2)))
    if len(kept) < FEWEST or length < _LENGTH or noise > _TOLD * length or not 1 / _ODD < solution[0] < _ODD:
        return 1.0, np.inf
    inverse = np.linalg.pinv(rows.T @ rows, rcond=1e-12)
    sigma = noise * np.sqrt(max(inverse[0, 0], 0.0) * len(right) / max(len(right) - 7, 1))
    return float(solution[0]), float(sigma)


def _turned(poses: Array, mount: Mount) -> Array:
    """From T_camera_board to B flange X and back: inverted for a camera in the hand."""
    return spatial.inverse(poses) if mount == "hand" else poses


def _each(views: Array, predicted: Array, centre: Array) -> Array:
    """Misfit of every pose that a view may be, shape (..., k), mm; infinite where there is none.

    Args:
        views: shape (..., k, 4, 4). predicted: T_camera_board, shape (..., 4, 4).
    """
    points = centre + np.vstack([np.zeros(3), LEVER * np.eye(3)])
    off = (views - predicted[..., None, :, :])[..., :3, :] @ np.column_stack([points, np.ones(4)]).T
    rms = np.sqrt(np.mean(np.sum(off**2, axis=-2), axis=-1))
    return np.where(np.isfinite(rms), rms, np.inf)
