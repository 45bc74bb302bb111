"""First values of base, tool and tool points, found from the data with the nominal robot: nobody has to type them.

With the tool known the base is a rigid fit in closed form ([Umeyama1991]), and the other way round; the two are
alternated from several first tools, all at once. For pose data the closed form of measured_i = B flange_i X
([Shah2013]) is one of the starts. What comes out is a first guess: Levenberg-Marquardt refines the best few.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal import spatial

Array = NDArray[np.float64]

LEVER = 200.0
"""mm: a pose is seen as its origin and a point at this distance along each axis."""

_ALTERNATIONS = 25
_SETTLED = 1e-3
_SAME = 1.02
_GUESSES = 3


@dataclass(frozen=True, slots=True)
class Registration:
    """Base and tool (4, 4), tool points (k, 3) in mm, and the rms distance (mm) that they leave."""

    base: Array
    tool: Array
    points: Array
    rms: float


def rigid_fit(source: Array, target: Array) -> Array:
    """T_target_source, shape (..., 4, 4): least squares over pairs of points (..., k, 3). Source: [Umeyama1991]."""
    a, b = source.mean(axis=-2), target.mean(axis=-2)
    u, _, vt = np.linalg.svd((target - b[..., None, :]).swapaxes(-1, -2) @ (source - a[..., None, :]))
    u[..., :, 2] *= np.linalg.det(u @ vt)[..., None]
    rotation = u @ vt
    return _transforms(rotation, b - np.einsum("...ij,...j->...i", rotation, a))


def _transforms(rotation: Array, translation: Array) -> Array:
    t = np.zeros((*rotation.shape[:-2], 4, 4))
    t[..., :3, :3], t[..., :3, 3], t[..., 3, 3] = rotation, translation, 1.0
    return t


def hand_eye(flange: Array, measured: Array) -> tuple[Array, Array]:
    """Base B and tool X, shape (..., 4, 4) each, with measured_i = B flange_i X; shapes (..., N, 4, 4).

    With Y = R_X^T every pose says R_z Y = R_B R_F, so (vec Y, vec R_B) is the leading pair of singular vectors of
    sum kron(R_z, R_F); the translations follow linearly. Needs rotations about two axes. Source: [Shah2013].
    """
    a, b = flange[..., :3, :3], measured[..., :3, :3]
    over = a.shape[:-3]
    u, _, vt = np.linalg.svd(np.einsum("...nij,...nkl->...ikjl", b, a).reshape(*over, 9, 9))
    tool = _nearest_rotation(vt[..., 0, :].reshape(*over, 3, 3)).swapaxes(-1, -2)
    base = _nearest_rotation(u[..., :, 0].reshape(*over, 3, 3))
    # p_z - R_B p_F = p_B + (R_B R_F) p_X
    turned = base[..., None, :, :] @ a
    rows = np.concatenate([np.broadcast_to(np.eye(3), a.shape), turned], axis=-1).reshape(*over, -1, 6)
    right = measured[..., :3, 3] - np.einsum("...ij,...nj->...ni", base, flange[..., :3, 3])
    solution = np.linalg.pinv(rows, rcond=1e-8) @ right.reshape(*over, -1, 1)
    return _transforms(base, solution[..., :3, 0]), _transforms(tool, solution[..., 3:, 0])


def _nearest_rotation(matrix: Array) -> Array:
    u, _, vt = np.linalg.svd(matrix * np.sign(np.linalg.det(matrix))[..., None, None])
    u[..., :, 2] *= np.linalg.det(u @ vt)[..., None]
    return np.asarray(u @ vt)


def virtual_points(poses: Array) -> Array:
    """Origin and three axis points of poses (N, 4, 4), shape (N, 4, 3), mm."""
    offsets = np.vstack([np.zeros(3), LEVER * np.eye(3)])
    return np.asarray(poses[:, None, :3, 3] + np.einsum("nij,kj->nki", poses[:, :3, :3], offsets))


def register(
    flange: Array,
    measured: Array,
    nominal: Registration,
    *,
    base: bool,
    tool: Literal["frame", "position", "points"] | None,
    starts: tuple[Registration, ...] = (),
) -> list[Registration]:
    """The best few guesses of what is to be estimated, best first.

    Args:
        flange: T_base_flange by nominal kinematics, shape (N, 4, 4). measured: points in world, shape (N, k, 3), NaN
            where not seen.
        nominal: what is known or guessed; parts that are not estimated stay as they are. base: estimate the base.
        tool: estimate the tool's frame, its position, or every point by itself. starts: further first guesses.
    """
    seen: NDArray[np.bool_] = np.asarray(np.isfinite(measured).all(axis=2))
    found = _alternate(flange, measured, seen, (nominal, *starts, *_starts(nominal, base, tool)), base, tool)
    distinct: list[Registration] = []
    while found and len(distinct) < _GUESSES:
        limit = _SAME * min(r.rms for r in found)
        # of guesses that are as good, the first: the nominal one where the data leave a choice
        distinct.append(next(r for r in found if r.rms <= limit))
        found = [r for r in found if r.rms > limit]
    return distinct


def _starts(nominal: Registration, base: bool, tool: str | None) -> Iterator[Registration]:
    """First tools all around, where neither base nor tool is known."""
    if not base or tool is None:
        return
    if tool == "frame":
        for *_, rotation in spatial.signed_permutations():
            if np.linalg.det(rotation) > 0:
                yield Registration(
                    nominal.base, nominal.tool @ spatial.transform(rotation, np.zeros(3)), nominal.points, np.inf
                )
    else:
        for axis, distance in product(range(3), (-400.0, -100.0, 100.0, 400.0)):
            shift = distance * np.eye(3)[axis]
            yield Registration(nominal.base, nominal.tool, nominal.points + shift, np.inf)


def _alternate(
    flange: Array,
    measured: Array,
    seen: NDArray[np.bool_],
    starts: Sequence[Registration],
    base: bool,
    tool: str | None,
) -> list[Registration]:
    """Every start after rigid fits of base and tool in turn, until their residuals settle; arrays are by start."""
    b, x, points = (np.array([getattr(start, name) for start in starts]) for name in ("base", "tool", "points"))
    pose, point = np.nonzero(seen)
    world = measured[pose, point]
    r_flange, p_flange = flange[pose, :3, :3], flange[pose, :3, 3]
    counts = np.bincount(point, minlength=points.shape[1])
    average = (point == np.arange(points.shape[1])[:, None]) / np.maximum(counts, 1)[:, None]

    def moved(frame: Array, p: Array) -> Array:
        return np.asarray(p @ frame[:, :3, :3].swapaxes(1, 2) + frame[:, None, :3, 3])

    def in_base() -> Array:
        return np.asarray(p_flange + np.einsum("mij,smj->smi", r_flange, moved(x, points)[:, point], optimize=True))

    rms = np.full(len(starts), np.inf)
    for _ in range(_ALTERNATIONS):
        if base:
            b = rigid_fit(in_base(), np.broadcast_to(world, (len(starts), *world.shape)))
        if tool:
            local = moved(spatial.inverse(b), np.broadcast_to(world, (len(starts), *world.shape))) - p_flange
            on_flange = np.einsum("mji,smj->smi", r_flange, local, optimize=True)
            if tool == "frame":
                x = rigid_fit(points[:, point], on_flange)
            elif tool == "position":
                turned = points[:, point] @ x[:, :3, :3].swapaxes(1, 2)
                x = _transforms(x[:, :3, :3], (on_flange - turned).mean(axis=1))
            else:
                points = np.where(counts[:, None] > 0, average @ moved(spatial.inverse(x), on_flange), points)
        last, rms = rms, np.sqrt(np.mean(np.sum((moved(b, in_base()) - world) ** 2, axis=2), axis=1))
        if not (base and tool) or np.all(last - rms <= _SETTLED * rms):
            break
    return [Registration(*each) for each in zip(b, x, points, rms.tolist(), strict=True)]
