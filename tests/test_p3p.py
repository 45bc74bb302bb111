"""P3P: known truth over random visible poses, OpenCV's solver as witness, covariance by Monte Carlo."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial.transform import Rotation

from symcal.camera.camera import Camera, in_image, project_points
from symcal.camera.p3p import points_covariance, solve_p3p, solve_p3p_batch, view_angles
from symcal.camera.reproject import fit_pose, moved, reproject
from symcal.camera.target import Target
from symcal.errors import InputError, RefusedError

Float = NDArray[np.float64]

CAMERA = Camera(2448, 2048, 4638.0, 4640.0, 1231.0, 1017.0, (-0.12, 0.09, 4e-4, -3e-4, 0.02))
TRIANGLE = Target.triangle(200.0, 15.0)
SCALENE = np.array([[0.0, 0.0, 0.0], [180.0, 20.0, 0.0], [40.0, 130.0, 30.0]])


def place(points: Float, poses: Float) -> Float:
    """Image points by OpenCV, shape (n, 3, 2)."""
    views = [
        cv2.projectPoints(points, cv2.Rodrigues(T[:3, :3])[0], T[:3, 3], CAMERA.matrix, np.array(CAMERA.dist))[0]
        for T in poses
    ]
    return np.array(views).reshape(len(poses), len(points), 2)


def visible_poses(n: int, rng: np.random.Generator, points: Float = TRIANGLE.points, limit_deg: float = 75.0) -> Float:
    """Random rotations and places at 1 to 3 m that show the face, all points inside the image; shape (n, 4, 4)."""
    found: list[Float] = []
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    while len(found) < n:
        poses = np.tile(np.eye(4), (4 * n, 1, 1))
        poses[:, :3, :3] = Rotation.random(4 * n, random_state=rng).as_matrix()
        z = rng.uniform(1000, 3000, (4 * n, 1))
        poses[:, :3, 3] = np.concatenate([rng.uniform(-0.28, 0.28, (4 * n, 2)) * z, z], axis=1)
        incidence = view_angles(points, poses, normal)[1]
        pixels = project_points(CAMERA, points @ poses[:, :3, :3].swapaxes(1, 2) + poses[:, None, :3, 3])
        found.extend(poses[(incidence < limit_deg) & in_image(CAMERA, pixels).all(axis=1)])
    return np.array(found[:n])


def predicted(poses: Float, rng: np.random.Generator, mm: float = 3.0, deg: float = 0.5) -> Float:
    """Nominal poses that are wrong by a length and an angle, in random directions."""
    way = rng.normal(size=(2, len(poses), 3))
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    return moved(poses, np.concatenate([mm * way[0], math.radians(deg) * way[1]], axis=-1))


@pytest.mark.parametrize("sigma_px", [0.0, 0.02])
def test_chosen_solution_is_the_true_one_beyond_the_cylinder(sigma_px: float, rng: np.random.Generator) -> None:
    poses = visible_poses(10_000, rng)
    pixels = reproject(CAMERA, poses, TRIANGLE.points)[0] + sigma_px * rng.normal(size=(10_000, 3, 2))
    results = solve_p3p_batch(CAMERA, TRIANGLE.points, pixels, predicted(poses, rng))
    _, incidence, cylinder = view_angles(TRIANGLE.points, poses, np.array([0.0, 0.0, 1.0]))
    beyond = incidence - cylinder
    sure = np.array([r is not None and r.sure for r in results])
    assert all(r.reason for r in results if r is not None and not r.sure)

    # noise moves the border of the flag a little; the true pose is the solution whose rotation is nearest to it
    border = 1e-3 if sigma_px == 0 else 0.2
    far, near = beyond > 5 + border, beyond < 5 - border
    assert far.sum() > 9000
    assert near.sum() > 20
    assert np.all(sure[far])
    assert not np.any(sure[near])
    for i in np.flatnonzero(sure):
        result = results[i]
        assert result is not None
        error = np.abs(result.solutions - poses[i])
        assert error[:, :3, :3].max(axis=(1, 2)).argmin() == result.chosen
        assert sigma_px > 0 or error[result.chosen].max() < 1e-8


@pytest.mark.parametrize("points", [TRIANGLE.points, SCALENE], ids=["equilateral", "scalene"])
def test_all_solutions_agree_with_opencv(points: Float, rng: np.random.Generator) -> None:
    poses = visible_poses(400, rng, points)
    pixels = place(points, poses)
    results = solve_p3p_batch(CAMERA, points, pixels, poses)
    center, face = points.mean(axis=0), np.cross(points[1] - points[0], points[2] - points[0])
    more = 0
    for image, result in zip(pixels, results, strict=True):
        count, rotations, translations = cv2.solveP3P(
            points, image, CAMERA.matrix, np.array(CAMERA.dist), flags=cv2.SOLVEPNP_AP3P
        )
        assert result is not None
        assert np.abs(place(points, result.solutions) - image).max() < 1e-8
        for i in range(count):
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = cv2.Rodrigues(rotations[i])[0], translations[i].ravel()
            in_front = np.all((points @ T[:3, :3].T + T[:3, 3])[:, 2] > 0)
            facing = (T[:3, :3] @ face) @ (T[:3, :3] @ center + T[:3, 3]) < 0
            exact = np.abs(place(points, T[None]) - image).max() < 1e-3
            if in_front and facing and exact:
                assert np.abs(result.solutions - T).max(axis=(1, 2)).min() < 2.0
        more += len(result.solutions) > 2
    assert more >= 1


def test_true_pose_is_always_among_the_solutions_of_symmetric_views() -> None:
    # frontal and axis-aligned views make the cubic of the pencil degenerate
    for tilt in (0.0, 1.0, 20.0, 60.0):
        for axis in ("x", "y"):
            T = np.eye(4)
            T[:3, :3] = (
                Rotation.from_euler("x", 180, degrees=True) * Rotation.from_euler(axis, tilt, True)
            ).as_matrix()
            T[2, 3] = 2000.0
            pinhole = Camera(2448, 2048, 4638.0, 4638.0, 1223.5, 1023.5)
            result = solve_p3p(pinhole, TRIANGLE.points, reproject(pinhole, T, TRIANGLE.points)[0], T)
            assert np.abs(result.T_camera_target - T).max() < 1e-6
            assert result.tilt_deg == pytest.approx(tilt, abs=1e-6)
            assert result.incidence_deg == pytest.approx(tilt, abs=1e-6)
            assert result.beyond_deg == pytest.approx(
                tilt - math.degrees(math.asin(200 / math.sqrt(3) / 2000)), abs=1e-6
            )
            assert result.sure == (tilt > 8.4)


def test_covariance_follows_chi_squared(rng: np.random.Generator) -> None:
    T, sigma, n = visible_poses(1, rng, limit_deg=60.0), 0.02, 4000
    exact = place(TRIANGLE.points, T)
    result = solve_p3p(CAMERA, TRIANGLE.points, exact[0], T[0], sigma)
    assert result.sure
    noisy = exact + sigma * rng.normal(size=(n, 3, 2))
    results = [r for r in solve_p3p_batch(CAMERA, TRIANGLE.points, noisy, np.repeat(T, n, axis=0)) if r is not None]
    assert len(results) == n
    found = np.array([r.T_camera_target for r in results])
    turn = Rotation.from_matrix(T[0, :3, :3].T @ found[:, :3, :3]).as_rotvec()
    error = np.concatenate([found[:, :3, 3] - T[0, :3, 3], turn], axis=1)
    scores = np.einsum("ni,ij,nj->n", error, np.linalg.inv(result.covariance), error)
    assert stats.kstest(scores, stats.chi2(6).cdf).pvalue > 1e-3

    spread = (TRIANGLE.points @ found[:, :3, :3].swapaxes(1, 2) + found[:, None, :3, 3]).reshape(n, 9)
    sample = np.cov(spread.T)
    full = points_covariance(result, TRIANGLE.points)
    assert np.linalg.matrix_rank(full, tol=1e-12 * np.linalg.norm(full)) == 6
    assert np.abs(sample - full).max() < 0.1 * np.abs(full).max()


def test_covariance_scales_with_each_points_noise(rng: np.random.Generator) -> None:
    T = visible_poses(1, rng)[0]
    pixels = place(TRIANGLE.points, T[None])[0]
    parts = [solve_p3p(CAMERA, TRIANGLE.points, pixels, T, s).covariance for s in 0.02 * np.eye(3)]
    whole = solve_p3p(CAMERA, TRIANGLE.points, pixels, T, 0.02).covariance
    assert np.allclose(sum(parts), whole, rtol=1e-9)


def test_flags() -> None:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", [180, 30, 20], degrees=True).as_matrix()
    T[:3, 3] = [30, -40, 2000]
    pixels = place(TRIANGLE.points, T[None])[0]
    assert solve_p3p(CAMERA, TRIANGLE.points, pixels, T).sure
    turned = moved(T, np.array([0, 0, 0, 0, 0.2, 0]))
    assert "turned by" in solve_p3p(CAMERA, TRIANGLE.points, pixels, turned).reason

    with pytest.raises(RefusedError, match="swapped"):
        solve_p3p(CAMERA, TRIANGLE.points, pixels[[1, 0, 2]], T)
    back = solve_p3p(CAMERA, TRIANGLE.points, pixels[[1, 0, 2]], T, normal=(0, 0, -1))
    assert back.incidence_deg < 90
    with pytest.raises(InputError, match="one line"):
        solve_p3p(CAMERA, np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), pixels, T)
    with pytest.raises(InputError, match="finite"):
        solve_p3p(CAMERA, TRIANGLE.points, pixels * np.nan, T)
    with pytest.raises(InputError, match=r"\(n, 3, 2\)"):
        solve_p3p(CAMERA, TRIANGLE.points, pixels[:2], T)


def test_on_the_degenerate_cylinder_nothing_breaks() -> None:
    # the line of sight to one corner is parallel to the normal: exactly on the cylinder
    T = np.eye(4)
    T[:3, :3] = np.diag([1.0, -1.0, -1.0])
    T[:3, 3] = [-200 / math.sqrt(3), 0, 2000]
    pinhole = Camera(2448, 2048, 4638.0, 4638.0, 1223.5, 1023.5)
    results = solve_p3p_batch(pinhole, TRIANGLE.points, reproject(pinhole, T, TRIANGLE.points)[0][None], T[None])
    if results[0] is not None:
        assert abs(results[0].beyond_deg) < 0.1
        assert not results[0].sure


@given(st.floats(-math.pi, math.pi), st.floats(0.0, 1.2), st.floats(-math.pi, math.pi), st.floats(800, 4000))
def test_degenerate_incidence_is_where_the_jacobian_loses_rank(
    around: float, tilt: float, roll: float, distance: float
) -> None:
    T = np.eye(4)
    T[:3, :3] = (Rotation.from_euler("x", math.pi) * Rotation.from_euler("zxz", [around, tilt, roll])).as_matrix()
    T[:3, 3] = [0.0, 0.0, distance]
    pinhole = Camera(2448, 2048, 4638.0, 4638.0, 1223.5, 1023.5)
    _, incidence, cylinder = view_angles(TRIANGLE.points, T, np.array([0.0, 0.0, 1.0]))
    assert incidence == pytest.approx(math.degrees(tilt), abs=1e-5)

    def determinant(pose: Float) -> float:
        return float(
            np.linalg.det(reproject(pinhole, pose, TRIANGLE.points)[1].reshape(6, 6) / [1, 1, 1, 1e3, 1e3, 1e3])
        )

    on = T.copy()
    on[:3, :3] = (
        Rotation.from_euler("x", math.pi) * Rotation.from_euler("zxz", [around, math.radians(float(cylinder)), roll])
    ).as_matrix()
    off = T.copy()
    off[:3, :3] = (
        Rotation.from_euler("x", math.pi)
        * Rotation.from_euler("zxz", [around, math.radians(float(cylinder) + 10), roll])
    ).as_matrix()
    assert abs(determinant(on)) < 1e-9 * abs(determinant(off))


@given(st.integers(0, 2**32 - 1))
def test_reprojection_and_its_jacobian(seed: int) -> None:
    T = visible_poses(1, np.random.default_rng(seed))[0]
    pixels, jacobian = reproject(CAMERA, T, TRIANGLE.points)
    assert np.abs(pixels - place(TRIANGLE.points, T[None])[0]).max() < 1e-9
    steps = np.diag([1e-2, 1e-2, 1e-2, 1e-5, 1e-5, 1e-5])
    for k, step in enumerate(steps):
        ahead, behind = (reproject(CAMERA, moved(T, s), TRIANGLE.points)[0] for s in (step, -step))
        assert np.allclose((ahead - behind) / (2 * step[k]), jacobian[..., k], rtol=1e-6, atol=1e-5)


def test_fit_pose_reproduces_pixels_and_keeps_the_prediction_where_it_sees_nothing(rng: np.random.Generator) -> None:
    T = visible_poses(1, rng, limit_deg=50)[0]
    start = predicted(T[None], rng)[0]
    fitted = fit_pose(CAMERA, start, TRIANGLE.points, place(TRIANGLE.points, T[None])[0])
    assert np.abs(reproject(CAMERA, fitted, TRIANGLE.points)[0] - place(TRIANGLE.points, T[None])[0]).max() < 1e-3
    assert np.array_equal(fit_pose(CAMERA, start, np.zeros((0, 3)), np.zeros((0, 2))), start)
