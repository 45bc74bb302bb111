"""Poses of flat targets from one image, against the pose that made the image."""

from __future__ import annotations

import numpy as np
import pytest
from boards import CAMERA, LARGE
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from symcal.camera.camera import Camera, in_image, project_points
from symcal.camera.planar_pose import planar_poses
from symcal.spatial import transform

Array = NDArray[np.float64]
FACE = np.array([0.0, 0.0, -1.0])


def views(rng: np.random.Generator, count: int, tilt: float, depth: tuple[float, float]) -> Array:
    """Poses T_camera_board with the middle of the board near the middle of the image."""
    found = []
    for _ in range(count):
        turn = Rotation.from_euler("zyx", [rng.uniform(-np.pi, np.pi), *rng.uniform(-tilt, tilt, 2)]).as_matrix()
        at = np.array([*rng.uniform(-90, 90, 2), rng.uniform(*depth)])
        found.append(transform(turn, at - turn @ LARGE.points.mean(axis=0)))
    return np.array(found)


def images(camera: Camera, poses: Array, sigma: float, rng: np.random.Generator) -> Array:
    at = np.einsum("nij,kj->nki", poses[:, :3, :3], LARGE.points) + poses[:, None, :3, 3]
    pixels = project_points(camera, at)
    pixels += sigma * rng.normal(size=pixels.shape)
    return np.where(in_image(camera, pixels)[..., None], pixels, np.nan)


def off(found: Array, true: Array) -> tuple[Array, Array]:
    """Turn, rad, and shift of the board's middle, mm."""
    step = np.linalg.inv(true) @ found
    middle = LARGE.points.mean(axis=0)
    shift = np.einsum("nij,j->ni", step[:, :3, :3], middle) + step[:, :3, 3] - middle
    return Rotation.from_matrix(step[:, :3, :3]).magnitude(), np.linalg.norm(shift, axis=1)


def test_exact_images_give_the_exact_pose() -> None:
    rng = np.random.default_rng(0)
    true = views(rng, 40, 1.0, (350, 900))
    poses, rms = planar_poses(CAMERA, LARGE.points, images(CAMERA, true, 0.0, rng), FACE)
    turn, shift = off(poses[:, 0], true)
    assert rms[:, 0].max() < 1e-6
    assert turn.max() < 1e-8
    assert shift.max() < 1e-5


def test_noise_and_views_of_a_part_do_no_harm() -> None:
    rng = np.random.default_rng(1)
    true = views(rng, 60, 0.9, (220, 420))
    pixels = images(CAMERA, true, 0.5, rng)
    seen = np.isfinite(pixels).all(axis=2).sum(axis=1)
    true, pixels = true[seen > 20], pixels[seen > 20]
    assert (seen < 60).any()
    poses, rms = planar_poses(CAMERA, LARGE.points, pixels, FACE)
    turn, shift = off(poses[:, 0], true)
    assert rms[:, 0].max() < 1.5
    assert turn.max() < np.deg2rad(2.0)
    assert shift.max() < 5.0


def test_a_board_far_away_has_two_poses_of_which_one_is_true() -> None:
    """Mirrored about the line of sight; both fit the noise, and which is better is chance."""
    rng = np.random.default_rng(2)
    true = views(rng, 60, 0.5, (5000, 6000))
    poses, rms = planar_poses(CAMERA, LARGE.points, images(CAMERA, true, 1.0, rng), FACE)
    turn = np.array([off(poses[:, k], true)[0] for k in (0, 1)]).T
    tilted = np.abs(off(true, views(rng, 60, 0.0, (5000, 6000)))[0]) > 0
    assert tilted.all()
    assert (turn.min(axis=1) < np.deg2rad(8.0)).mean() > 0.9
    assert 0.02 < (turn[:, 1] < turn[:, 0]).mean() < 0.6
    assert np.isfinite(rms).all()


def test_what_cannot_be_a_pose_is_none() -> None:
    """Too few points, points on a line, and a board from behind."""
    rng = np.random.default_rng(3)
    true = views(rng, 3, 0.6, (500, 600))
    pixels = images(CAMERA, true, 0.0, rng)
    pixels[0, 3:] = np.nan
    pixels[1, 11:] = np.nan  # the first row of corners alone
    _, rms = planar_poses(CAMERA, LARGE.points, pixels, FACE)
    assert np.isinf(rms[:2]).all()
    assert np.isfinite(rms[2, 0])
    _, behind = planar_poses(CAMERA, LARGE.points, pixels, -FACE)
    assert np.isinf(behind[2, 0]) or behind[2, 0] > 10.0


@pytest.mark.parametrize("dist", [(), (-0.3, 0.12, 0.001, -0.001, 0.0)])
def test_it_agrees_with_opencv(dist: tuple[float, ...]) -> None:
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(4)
    camera = Camera(2448, 2048, 2300.0, 2310.0, 1200.0, 1000.0, dist)
    for true in views(rng, 10, 0.8, (450, 800)):
        pixels = images(camera, true[None], 0.2, rng)
        seen = np.isfinite(pixels[0]).all(axis=1)
        k = np.flatnonzero(seen)[:: max(int(seen.sum()) // 20, 1)]
        only = np.full_like(pixels, np.nan)
        only[0, k] = pixels[0, k]
        if len(k) > 24:
            k = k[:24]
            only = np.full_like(pixels, np.nan)
            only[0, k] = pixels[0, k]
        (poses,), _ = planar_poses(camera, LARGE.points, only, FACE)
        lens = np.array([*camera.dist])
        found, r, t = cv2.solvePnP(LARGE.points[k], pixels[0, k], camera.matrix, lens, flags=cv2.SOLVEPNP_ITERATIVE)
        assert found
        theirs = transform(Rotation.from_rotvec(r.ravel()).as_matrix(), t.ravel())
        turn, shift = off(poses[:1], theirs[None])
        assert turn[0] < 1e-4
        assert shift[0] < 0.05
