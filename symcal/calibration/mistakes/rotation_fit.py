r"""How well a chain with both of its ends free explains what was read, in closed form but for three numbers.

With the chain's pose (R_i, p_i), the base's turn and shift (B, t) and a point y_k on the moving end

    B (p_i + R_i y_k) + t = z_ik    <=>    M z_ik + s - R_i y_k = p_i,    M = B^T, s = -B^T t,

which is linear in M, s and y_k. The y_k of least squares is the mean of R_i^T (M z_ik + s - p_i), s follows from a
3 x 3 system, and what is left is a quadratic form in (vec M, -1) whose ten by ten matrix comes from sums over the
poses: no pose is looked at again while the rotation M is searched for. Axes of frames are read likewise, without p_i
and s. The points y_k are free: that they belong to one rigid target is not asked for, and good data need not be asked.
The elimination is ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.spatial import signed_permutations

Array = NDArray[np.float64]

COUNT, SIZE = 25, 65
"""Place of the number of poses in `sums`."""

_NINE = 9
_STEPS = 40
_SETTLED = 1e-10
_SINGULAR = 1e-9  # of the poses: shifts of the base that the free points take over
_KEPT = 4  # starts that are followed to the end
_FIRST = 6  # steps after which they are chosen


@dataclass(frozen=True, slots=True)
class Channel:
    """What was read of one feature in N poses.

    read: shape (..., N, 3), zero where not seen: a point, mm, or an axis times a lever, mm. seen: shape (..., N).
    located: it is a point; axes have no place.
    """

    read: Array
    seen: NDArray[np.bool_]
    located: bool


def sums(rotation: Array, position: Array, channel: Channel) -> Array:
    """What the quadratic form of a channel needs of every pose, shape (..., N, 65); it is added up over poses.

    Args:
        rotation, position: R_i and p_i of the chain, shapes (..., N, 3, 3) and (..., N, 3), mm.
    """
    z, p = channel.read, position if channel.located else np.zeros_like(position)
    there = np.broadcast_to(channel.seen, np.broadcast_shapes(channel.seen.shape, p.shape[:-1]))
    over = there.shape

    def flat(values: Array) -> Array:
        return np.broadcast_to(values.reshape(*values.shape[: values.ndim - 2], -1), (*over, values[..., 0, 0].size))

    def outer(a: Array, b: Array) -> Array:
        both = a[..., :, None] * b[..., None, :]
        return np.broadcast_to(both.reshape(*both.shape[:-2], -1), (*over, both.shape[-1] * both.shape[-2]))

    turned = np.einsum("...ji,...j->...i", rotation, p)
    pieces = [
        outer(z, z),
        np.broadcast_to(z, (*over, 3)),
        outer(p, z),
        np.broadcast_to(p, (*over, 3)),
        np.broadcast_to(np.sum(p * p, axis=-1)[..., None], (*over, 1)),
        np.ones((*over, 1)),
        outer(np.swapaxes(rotation, -1, -2).reshape(*rotation.shape[:-2], 9), z),
        np.broadcast_to(np.swapaxes(rotation, -1, -2).reshape(*rotation.shape[:-2], 9), (*over, 9)),
        np.broadcast_to(turned, (*over, 3)),
    ]
    return np.concatenate(pieces, axis=-1) * there[..., None]


def form(channels: list[tuple[Array, bool]]) -> Array:
    """The quadratic form of some channels with s eliminated, shape (..., 10, 10), mm^2; squares of (vec M, -1).

    Args:
        channels: sums over poses of each, shape (..., 65), and whether it is located.
    """
    total: Array | None = None
    for of, located in channels:
        own = _gram(of, located)
        total = own if total is None else total + own
    assert total is not None
    middle = total[..., 9:12, 9:12]
    count = np.maximum(np.trace(middle, axis1=-2, axis2=-1), 1.0)[..., None, None]
    values, axes = np.linalg.eigh(middle / count)
    inverse = np.where(values > _SINGULAR, 1 / np.where(values > _SINGULAR, values, 1.0), 0.0)
    solved = np.einsum("...ij,...j,...kj->...ik", axes, inverse, axes) / count
    keep = [*range(_NINE), 12]
    cross = total[..., keep, 9:12]
    return np.asarray(total[..., keep, :][..., keep] - cross @ solved @ np.swapaxes(cross, -1, -2))


def _gram(of: Array, located: bool) -> Array:
    """The form over (vec M, s, -1) of one channel with its point eliminated, shape (..., 13, 13)."""
    over, cut = of.shape[:-1], np.cumsum([9, 3, 9, 3, 1, 1, 27, 9])
    zz, z, pz, p, pp, n, rz, r, rp = np.split(of, cut, axis=-1)
    gram = np.zeros((*over, 13, 13))
    for a in range(3):
        rows = slice(3 * a, 3 * a + 3)
        gram[..., rows, rows] = zz.reshape(*over, 3, 3)
        gram[..., rows, 12] = gram[..., 12, rows] = pz.reshape(*over, 3, 3)[..., a, :]
        if located:
            gram[..., rows, 9 + a] = gram[..., 9 + a, rows] = z
            gram[..., 9 + a, 9 + a] = n[..., 0]
            gram[..., 9 + a, 12] = gram[..., 12, 9 + a] = p[..., a]
    gram[..., 12, 12] = pp[..., 0]
    mean = np.zeros((*over, 3, 13))  # of the rows turned into the moving end, times the poses
    mean[..., :9] = rz.reshape(*over, 3, 9)
    if located:
        mean[..., 9:12] = r.reshape(*over, 3, 3)
    mean[..., 12] = rp
    return gram - np.swapaxes(mean, -1, -2) @ mean / np.maximum(n[..., None], 1.0)


def least(quadratic: Array) -> tuple[Array, Array]:
    """The rotation M that leaves least, shape (..., 3, 3), and what it leaves, shape (...), mm^2.

    From the 24 turns by right angles and the projection of the unconstrained M, by Levenberg-Marquardt on the
    rotations, all at once.
    """
    over = quadratic.shape[:-2]
    flat = quadratic.reshape(-1, 1, 10, 10)
    m = np.concatenate([np.broadcast_to(_TURNS, (len(flat), 24, 3, 3)), _projected(flat[:, 0])[:, None]], axis=1)
    m, cost = _descended(flat, m, _FIRST)
    best = np.argsort(cost, axis=1)[:, :_KEPT]
    m, cost = _descended(flat, np.take_along_axis(m, best[:, :, None, None], axis=1), _STEPS)
    first = np.argmin(cost, axis=1)
    every = np.arange(len(flat))
    return m[every, first].reshape(*over, 3, 3), np.maximum(cost[every, first], 0.0).reshape(over)


def least_left(quadratic: Array) -> Array:
    """What no rotation leaves less than of forms (K, 10, 10), shape (K,), mm^2.

    Any matrix may stand for M, with a little of its squared norm added to make the minimum one, and taken off again:
    the squared norm of a rotation is three.
    """
    a, b = quadratic[:, :_NINE, :_NINE], quadratic[:, :_NINE, _NINE]
    little = _SINGULAR * np.trace(a, axis1=1, axis2=2) + 1e-300
    m = np.linalg.solve(a + little[:, None, None] * np.eye(_NINE), b[:, :, None])[:, :, 0]
    return np.asarray(np.maximum(quadratic[:, _NINE, _NINE] - np.sum(b * m, axis=1) - 3 * little, 0.0))


def left(quadratic: Array, m: Array) -> Array:
    """What a rotation leaves of a form, shape (...), mm^2."""
    v = np.concatenate([m.reshape(*m.shape[:-2], 9), -np.ones((*m.shape[:-2], 1))], axis=-1)
    return np.asarray(np.maximum((v[..., None, :] @ quadratic @ v[..., :, None])[..., 0, 0], 0.0))


_TURNS = np.array([turn for *_, turn in signed_permutations() if np.linalg.det(turn) > 0])
_GENERATORS = np.array(
    [[[0, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 0, 0], [-1, 0, 0]], [[0, -1, 0], [1, 0, 0], [0, 0, 0]]]
)


def _projected(flat: Array) -> Array:
    """The rotation nearest to the M of least squares without constraint, shape (K, 3, 3)."""
    a, b = flat[:, :9, :9], flat[:, :9, 9]
    values, axes = np.linalg.eigh(a)
    top = np.maximum(values[:, -1:], 1e-12)
    told = values > _SINGULAR * top
    inverse = np.where(told, 1 / np.where(told, values, 1.0), 0.0)
    m = np.einsum("kij,kj,klj,kl->ki", axes, inverse, axes, b).reshape(-1, 3, 3)
    u, _, vt = np.linalg.svd(m)
    u[..., 2] *= np.linalg.det(u @ vt)[:, None]
    return np.asarray(u @ vt)


def _descended(flat: Array, m: Array, steps: int) -> tuple[Array, Array]:
    """Rotations (K, S, 3, 3) after at most so many steps on K forms, shape (K, 1, 10, 10), and what they leave, (K, S).

    One that has settled takes no part in further steps.
    """
    over = m.shape[:2]
    every = np.broadcast_to(flat, (*over, 10, 10)).reshape(-1, 10, 10)
    m = m.reshape(-1, 3, 3).copy()
    cost = left(every, m)
    size = np.maximum(np.trace(every[:, :9, :9], axis1=-2, axis2=-1) / 3, 1e-12)
    damping = np.full(cost.shape, 1e-3)
    open_ = np.arange(len(m))
    for _ in range(steps):
        if not open_.size:
            break
        form_, at, was = every[open_], m[open_], cost[open_]
        slopes = (at[:, None] @ _GENERATORS).reshape(-1, 3, 9)
        v = np.concatenate([at.reshape(-1, 9), -np.ones((len(at), 1))], axis=1)
        gradient = slopes @ (form_[:, :9] @ v[:, :, None])
        curved = slopes @ form_[:, :9, :9] @ np.swapaxes(slopes, -1, -2)
        curved += (damping[open_] * size[open_] + 1e-300)[:, None, None] * np.eye(3)
        tried = at @ _turned(np.linalg.solve(curved, -gradient)[:, :, 0])
        new = left(form_, tried)
        better = new < was
        m[open_[better]], cost[open_[better]] = tried[better], new[better]
        damping[open_] = np.clip(np.where(better, damping[open_] / 5, damping[open_] * 5), 1e-12, 1e6)
        settled = np.where(better, was - new < _SETTLED * np.maximum(was, 1e-300), damping[open_] >= 1e3)
        open_ = open_[~settled]
    return m.reshape(*over, 3, 3), cost.reshape(over)


def _turned(vector: Array) -> Array:
    """Rotation matrices of rotation vectors, shape (..., 3, 3)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    k = np.einsum("...g,gij->...ij", vector, _GENERATORS)
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    return np.asarray(
        np.eye(3)
        + np.where(small, 1.0, np.sin(safe) / safe) * k
        + np.where(small, 0.5, (1 - np.cos(safe)) / safe**2) * k @ k
    )
