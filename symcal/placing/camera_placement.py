"""First values of the camera's pose and of the target's mount, found from image points with the nominal robot.

Every pose gives up to four poses of three discs in the camera ([Ding2017] eq. 5, `symcal.camera.p3p`), or two of a flat
board (`symcal.camera.planar_pose`), of which one is true. With measured_i = B flange_i X, B = T_camera_base and X =
T_flange_target, three poses with one choice each give B and X in closed form (`registration.hand_eye`); the right
choice is the one that the image points of all poses agree with. Where it is not known either which disc is which, every
labelling is a choice more. The consensus search is ours.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.camera.board import Board
from symcal.camera.camera import Camera, project_points
from symcal.camera.p3p import solve_p3p_batch
from symcal.camera.planar_pose import planar_poses
from symcal.camera.target import Target
from symcal.errors import RefusedError
from symcal.placing.registration import hand_eye

Array = NDArray[np.float64]

_TRIPLES = 80  # sets of three poses that are tried, as long as their choices are few
_TRIES = 2000  # choices in all
_JUDGES = 40  # poses whose image points judge each try
_POINTS = 16  # points of each that do, or a few more
_ROUNDS = 6
_KEPT = 3
ODD = 6.0  # medians of all views: what errors of the nominal robot do not make of a few of them
_SAME = 1e-3  # mm and rad of two solutions that are one


@dataclass(frozen=True, slots=True)
class CameraPlacement:
    """T_base_camera and T_flange_target, shape (4, 4), mm, and the rms error that they leave in the image, px."""

    camera: Array
    mount: Array
    rms_px: float


def target_poses(camera: Camera, target: Target | Board, pixels: Array) -> list[Array]:
    """All poses T_camera_target of each image, shape (k_i, 4, 4) each, mm; none where fewer than three points are seen.

    Three points give up to four poses, a board gives two; those remain that the other points do not refute.

    Args:
        pixels: shape (N, n, 2), px; NaN where a point was not seen.
    """
    if isinstance(target, Board):
        both, errors = planar_poses(camera, target.points, pixels, np.array(target.normal))
        return [_likely(poses, error) for poses, error in zip(both, errors, strict=True)]
    seen: NDArray[np.bool_] = np.asarray(np.isfinite(pixels).all(axis=2))
    found = [np.zeros((0, 4, 4)) for _ in pixels]
    bases = sorted(combinations(range(len(target.names)), 3), key=lambda b: -_area(target.points[list(b)]))
    for base in bases:
        unsolved = np.array([not len(poses) for poses in found])
        open_ = np.flatnonzero(np.all(seen[:, list(base)], axis=1) & unsolved)
        if _area(target.points[list(base)]) == 0 or not open_.size:
            continue
        anywhere = np.broadcast_to(spatial.transform(np.eye(3), np.array([0.0, 0.0, 1e3])), (len(open_), 4, 4))
        points = target.points[list(base)]
        results = solve_p3p_batch(
            camera, points, pixels[open_][:, list(base)], anywhere, normal=_normal(points, target.normal)
        )
        for i, result in zip(open_, results, strict=True):
            if result is not None:
                error = np.array([_rms(camera, target, pose, pixels[i]) for pose in result.solutions])
                found[i] = _likely(result.solutions, error)
    return found


def _likely(poses: Array, error: Array) -> Array:
    """Poses that the image points do not refute, each once."""
    kept: Array = poses[np.isfinite(error) & (error <= 3 * error.min() + 0.5)]
    twice = len(kept) == 2 and np.allclose(kept[0], kept[1], rtol=0, atol=_SAME)
    return kept[:1] if twice else kept


def place_camera(
    camera: Camera,
    target: Target | Board,
    flange: Array,
    choices: Sequence[Array],
    pixels: Array,
    *,
    base: Array | None = None,
    mount: Array | None = None,
    rng: np.random.Generator | None = None,
) -> list[CameraPlacement]:
    """Camera pose and mount that image points of many poses agree on; the best few, best first.

    Args:
        flange: T_base_flange by nominal kinematics, shape (N, 4, 4), mm.
        choices: for every pose the poses T_camera_target that it may be, shape (k, 4, 4) each (`target_poses`).
        pixels: image points, shape (N, n, 2), px; or (N, c, n, 2) with c possible labellings each, NaN where fewer.
        base, mount: T_camera_base or T_flange_target if known.
        rng: draws the sets of poses that are tried; the same ones each time when None.
    Raises:
        RefusedError: too few poses with image points, or none that agree.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    pixels = pixels if pixels.ndim == 4 else pixels[:, None]
    usable = np.array([i for i, found in enumerate(choices) if len(found)], dtype=int)
    need = 3 if base is None and mount is None else 1
    if len(usable) < need:
        raise RefusedError(f"{len(usable)} poses show three points of the target, {need} are needed to find the camera")
    judges = usable[np.linspace(0, len(usable) - 1, min(len(usable), _JUDGES)).astype(int)]

    few = slice(None, None, max(len(target.points) // _POINTS, 1))
    asked = np.ascontiguousarray(pixels[judges][:, :, few])

    def score(b: Array, x: Array) -> float:
        return float(np.median(_errors(camera, target.points[few], b @ flange[judges] @ x, asked)))

    solve = _solver(base, mount)
    tried: list[tuple[float, Array, Array]] = []
    for group in _groups(usable, need, rng):
        if len(tried) > _TRIES:
            break
        for choice in product(*(range(len(choices[i])) for i in group)):
            measured = np.array([choices[i][k] for i, k in zip(group, choice, strict=True)])
            b, x = solve(flange[group], measured)
            tried.append((score(b, x), b, x))
    tried.sort(key=lambda entry: entry[0])
    best: list[CameraPlacement] = []
    for _, b, x in tried[: 4 * _KEPT]:
        found = _refined(camera, target, flange[usable], [choices[i] for i in usable], pixels[usable], b, x, solve)
        if all(abs(found.rms_px - other.rms_px) > 1e-3 * other.rms_px for other in best):
            best.append(found)
    best.sort(key=lambda entry: entry.rms_px)
    if not best or not np.isfinite(best[0].rms_px):
        raise RefusedError(
            "no pose of the camera agrees with the image points: check the joint readings and the target"
        )
    return best[:_KEPT]


def _refined(
    camera: Camera,
    target: Target | Board,
    flange: Array,
    choices: Sequence[Array],
    pixels: Array,
    b: Array,
    x: Array,
    solve: Callable[[Array, Array], tuple[Array, Array]],
) -> CameraPlacement:
    """All poses take the choice that is nearest to the prediction; those that agree give better B and X, until none
    changes."""
    last: list[int] = []
    for _ in range(_ROUNDS):
        predicted = b @ flange @ x
        off = _errors(camera, target.points, predicted, pixels)
        agree = np.flatnonzero(off <= ODD * np.median(off))
        nearest = [
            int(np.linalg.norm((found - pose)[:, :3, :3], axis=(1, 2)).argmin())
            for found, pose in zip(choices, predicted, strict=True)
        ]
        if nearest == last:
            break
        last = nearest
        b, x = solve(flange[agree], np.array([choices[i][nearest[i]] for i in agree.tolist()]))
    errors = _errors(camera, target.points, b @ flange @ x, pixels)
    rms = float(np.sqrt(np.mean(np.minimum(errors, camera.width + camera.height) ** 2)))
    return CameraPlacement(spatial.inverse(b), x, rms if np.isfinite(np.median(errors)) else np.inf)


def _solver(base: Array | None, mount: Array | None) -> Callable[[Array, Array], tuple[Array, Array]]:
    """B and X from poses of the flange and of the target, whatever of them is unknown."""

    def solve(flange: Array, measured: Array) -> tuple[Array, Array]:
        if base is None and mount is None:
            return hand_eye(flange, measured)
        if base is None and mount is not None:
            return _mean(measured @ spatial.inverse(flange @ mount)), mount
        assert base is not None
        return base, (_mean(spatial.inverse(base @ flange) @ measured) if mount is None else mount)

    return solve


def _mean(poses: Array) -> Array:
    """Mean of translations, and of rotations in the chordal sense, shape (N, 4, 4) -> (4, 4)."""
    u, _, vt = np.linalg.svd(poses[:, :3, :3].mean(axis=0))
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return spatial.transform(rotation, poses[:, :3, 3].mean(axis=0))


def _groups(usable: NDArray[np.intp], size: int, rng: np.random.Generator) -> list[NDArray[np.intp]]:
    """Random sets of poses; all of them where they are few."""
    every = list(combinations(usable.tolist(), size)) if len(usable) <= 9 or size == 1 else None
    if every is not None:
        order = rng.permutation(len(every))[:_TRIPLES]
        return [np.array(every[i], dtype=np.intp) for i in order]
    return [rng.choice(usable, size, replace=False) for _ in range(_TRIPLES)]


def _errors(camera: Camera, points: Array, poses: Array, pixels: Array) -> Array:
    """Rms error of the image points of each pose in the labelling that fits best, shape (N,), px.

    Infinite where a point cannot be seen.
    """
    placed = np.einsum("nij,kj->nki", poses[:, :3, :3], points) + poses[:, None, :3, 3]
    seen = np.isfinite(pixels).all(axis=3)
    off = np.sum((project_points(camera, placed)[:, None] - pixels) ** 2, axis=3)
    off = np.where(seen, np.where(np.isfinite(off), off, np.inf), 0.0)
    count = seen.sum(axis=2)
    mean = np.where(count > 0, off.sum(axis=2) / np.maximum(count, 1), np.inf)
    return np.asarray(np.sqrt(mean.min(axis=1)))


def _rms(camera: Camera, target: Target, pose: Array, pixels: Array) -> float:
    return float(_errors(camera, target.points, pose[None], pixels[None, None])[0])


def _area(corners: Array) -> float:
    return float(np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])))


def _normal(points: Array, normal: tuple[float, float, float]) -> Array:
    """The side from which the plane of three points is seen: that of the discs' faces, where the two are not across."""
    across = np.cross(points[1] - points[0], points[2] - points[0])
    along = float(across @ np.array(normal)) / float(np.linalg.norm(across))
    return across if abs(along) < 0.1 else np.array(normal)
