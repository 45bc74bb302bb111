"""Disc targets: centres against rendered truth, labels, and a named reason for every image that cannot be used."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from symcal.camera.camera import Camera, in_image, rays
from symcal.camera.reproject import moved
from symcal.camera.target import Target
from symcal.vision.failures import Failure, NotDetected
from symcal.vision.labelling import assign_labels
from symcal.vision.outlines import predict_outline
from symcal.vision.render import Look, render_discs
from symcal.vision.target import TargetDetection, detect_target

Float = NDArray[np.float64]

INDUSTRIAL = Camera(2448, 2048, 16 / 0.00345, 16 / 0.00345, 1231.0, 1017.0, (-0.12, 0.09, 4e-4, -3e-4, 0.02))
SMALL = Camera(960, 800, 1800.0, 1805.0, 482.0, 395.0, (-0.1, 0.05, 3e-4, -2e-4, 0.0))
TRIANGLE = Target.triangle(200.0, 15.0)
FIVE = Target(
    ("A", "B", "C", "D", "E"),
    np.array([[-90.0, -80, 0], [110, -60, 40], [90, 100, -30], [-70, 80, 20], [10, 0, 60]]),
    16.0,
)


def pose(
    tilt: float = 30.0, around: float = 20.0, roll: float = 0.0, xyz: tuple[float, ...] = (20, -10, 1000)
) -> Float:
    """Target that faces the camera but for its tilt about an axis in its plane, rolled about its normal; deg, mm."""
    T = np.eye(4)
    turn = Rotation.from_euler("x", 180, degrees=True) * Rotation.from_euler("zxz", [around, tilt, roll], degrees=True)
    T[:3, :3], T[:3, 3] = turn.as_matrix(), xyz
    return T


def truth(camera: Camera, points: Float, T: Float) -> Float:
    """Image points by OpenCV, shape (n, 2)."""
    turn = cv2.Rodrigues(T[:3, :3])[0]
    return cv2.projectPoints(points, turn, T[:3, 3], camera.matrix, np.array(camera.dist))[0].reshape(-1, 2)


def off(T: Float, rng: np.random.Generator, mm: float = 3.0, deg: float = 0.5) -> Float:
    """A nominal pose that is wrong by a length and an angle."""
    way = rng.normal(size=(2, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return moved(T, np.concatenate([mm * way[0], np.deg2rad(deg) * way[1]]))


def detect_small(
    T: Float, rng: np.random.Generator, target: Target = TRIANGLE, look: Look = Look(), **options: Any
) -> TargetDetection:
    return detect_target(SMALL, target, render_discs(SMALL, target, T, rng, look), off(T, rng), **options)


def refusal(image: NDArray[Any], T: Float, target: Target = TRIANGLE, **options: Any) -> NotDetected:
    with pytest.raises(NotDetected) as caught:
        detect_target(SMALL, target, image, T, **options)
    assert str(caught.value).startswith(caught.value.failure.value)
    return caught.value


def test_centres_of_an_industrial_camera(rng: np.random.Generator) -> None:
    errors, scores, raw = [], [], []
    while len(errors) < 10:
        z = rng.uniform(1500, 2500)
        x, y = rng.uniform(-0.2, 0.2, 2) * z
        tilt = 60.0 if len(errors) == 0 else rng.uniform(0, 60)
        T = pose(tilt, rng.uniform(0, 360), rng.uniform(0, 360), (x, y, z))
        pixels = truth(INDUSTRIAL, TRIANGLE.points, T)
        if not in_image(INDUSTRIAL, pixels, 70.0).all():
            continue
        image = render_discs(INDUSTRIAL, TRIANGLE, T, rng, Look(noise=0.01))
        found = detect_target(INDUSTRIAL, TRIANGLE, image, off(T, rng))
        assert found.names == TRIANGLE.names
        assert found.missed == ()
        errors.append(found.pixels - pixels)
        scores.append((found.pixels - pixels) / found.sigma_px[:, None])
        raw.append(found.pixels + found.bias_px - pixels)
        assert found.blur_px == pytest.approx(0.7, abs=0.1)
        assert found.disc_radius == pytest.approx(15.0, rel=3e-3)
    assert np.sqrt(np.mean(np.sum(np.square(errors), axis=-1))) <= 0.015
    assert np.sqrt(np.mean(np.sum(np.square(raw), axis=-1))) > 0.05
    assert 0.75 < np.sqrt(np.mean(np.square(scores))) < 1.3


@pytest.mark.parametrize(
    ("look", "limit", "options"),
    [
        (Look(noise=0.0, blur_px=0.5), 0.004, {}),
        (Look(noise=0.02, blur_px=1.5, vignetting=0.3), 0.06, {}),
        (Look(black=0.4, white=0.5, noise=0.005), 0.06, {}),
        (Look(), 0.015, {"colour": "black"}),
    ],
    ids=["clean", "blurred, noisy, vignetted", "pale", "black named"],
)
def test_centres_under_other_looks(look: Look, limit: float, options: dict[str, Any], rng: np.random.Generator) -> None:
    for around in (0, 100, 200):
        T = pose(40, around, 50)
        found = detect_small(T, rng, look=look, **options)
        assert np.abs(found.pixels - truth(SMALL, TRIANGLE.points, T)).max() < limit


def test_white_discs_and_16_bits(rng: np.random.Generator) -> None:
    T = pose()
    image = render_discs(SMALL, TRIANGLE, T, rng, discs="white").astype(np.uint16) * 257
    for colour in ("white", "any"):
        found = detect_target(SMALL, TRIANGLE, image, off(T, rng), colour=colour)
        assert np.abs(found.pixels - truth(SMALL, TRIANGLE.points, T)).max() < 0.03
    assert refusal(image, T, colour="black").failure in (Failure.NO_DISCS, Failure.TOO_FEW)


def test_prediction_may_be_far_off(rng: np.random.Generator) -> None:
    T = pose(35, 80)
    image = render_discs(SMALL, TRIANGLE, T, rng)
    found = detect_target(SMALL, TRIANGLE, image, moved(T, np.array([-30.0, 20, 40, 0.06, -0.05, 0.08])))
    assert np.abs(found.pixels - truth(SMALL, TRIANGLE.points, T)).max() < 0.03
    assert np.hypot(*found.shift_px) > 30


def test_wrong_radius_in_the_file_shows_and_does_no_harm(rng: np.random.Generator) -> None:
    T = pose(50)
    image = render_discs(SMALL, TRIANGLE, T, rng)
    found = detect_target(SMALL, Target.triangle(200, 13.0), image, off(T, rng))
    assert found.disc_radius == pytest.approx(15.0, rel=0.01)
    assert np.abs(found.pixels - truth(SMALL, TRIANGLE.points, T)).max() < 0.03


def test_clutter_is_left_alone(rng: np.random.Generator) -> None:
    T = pose(30, 10, xyz=(0, 0, 1100))
    image = render_discs(SMALL, TRIANGLE, T, rng)
    for center in ((100, 100), (850, 420), (480, 60), (140, 600)):
        cv2.circle(image, center, 24, 20, -1, cv2.LINE_AA)
    cv2.rectangle(image, (700, 600), (760, 650), 250, -1)
    found = detect_target(SMALL, TRIANGLE, image, off(T, rng), search_px=400.0)
    assert np.abs(found.pixels - truth(SMALL, TRIANGLE.points, T)).max() < 0.03


def test_non_coplanar_target_and_a_hidden_disc(rng: np.random.Generator) -> None:
    T = pose(25, 140, 30)
    pixels = truth(SMALL, FIVE.points, T)
    image = render_discs(SMALL, FIVE, T, rng)
    found = detect_target(SMALL, FIVE, image, off(T, rng))
    assert found.names == FIVE.names
    assert np.abs(found.pixels - pixels).max() < 0.03

    u, v = np.round(pixels[3]).astype(int)
    image[v - 5 : v + 40, u - 40 : u + 40] = 128
    found = detect_target(SMALL, FIVE, image, off(T, rng))
    assert found.names == ("A", "B", "C", "E")
    assert np.abs(found.pixels - pixels[[0, 1, 2, 4]]).max() < 0.03
    assert [(m.disc, m.failure) for m in found.missed] == [("D", Failure.HIDDEN)]
    assert refusal(image, T, FIVE, least=5).failure is Failure.TOO_FEW


def test_half_hidden_disc_is_named(rng: np.random.Generator) -> None:
    T = pose()
    pixels = truth(SMALL, TRIANGLE.points, T)
    image = render_discs(SMALL, TRIANGLE, T, rng)
    u, v = np.round(pixels[1]).astype(int)
    image[v - 6 : v + 50, u + 20 : u + 25] = 217
    assert refusal(image, T).failure in (Failure.HIDDEN, Failure.TOO_FEW)


@pytest.mark.parametrize("roll", [50.0, 60.0, 70.0])
def test_threefold_symmetry_is_ambiguous_without_a_mark(roll: float, rng: np.random.Generator) -> None:
    T, turned = pose(20, 0, 0), pose(20, 0, roll)
    image = render_discs(SMALL, TRIANGLE, T, rng)
    assert refusal(image, turned, search_px=300.0).failure is Failure.AMBIGUOUS

    marked = Target.triangle(200.0, 15.0, marked="P2")
    image = render_discs(SMALL, marked, T, rng)
    found = detect_target(SMALL, marked, image, turned, search_px=300.0)
    assert np.abs(found.pixels - truth(SMALL, marked.points, T)).max() < 0.03


@pytest.mark.parametrize("roll", [-120.0, -20.0, 20.0, 120.0, 180.0])
def test_mark_decides(roll: float, rng: np.random.Generator) -> None:
    T, marked = pose(50, 30, roll), Target.triangle(200.0, 15.0, marked="P1")
    image = render_discs(SMALL, marked, T, rng)
    found = detect_target(SMALL, marked, image, pose(50, 30, 0), search_px=300.0)
    assert np.abs(found.pixels - truth(SMALL, marked.points, T)).max() < 0.03


def render_spheres(camera: Camera, target: Target, T: Float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Dark balls before a light wall, by 36 rays per pixel."""
    light = np.full((camera.height, camera.width), 0.8)
    steps = (np.arange(6) + 0.5) / 6 - 0.5
    for center in target.points @ T[:3, :3].T + T[:3, 3]:
        u, v = np.round(truth(camera, center[None], np.eye(4))[0]).astype(int)
        columns, rows = np.arange(u - 50, u + 51), np.arange(v - 50, v + 51)
        total = np.zeros((101, 101))
        for du in steps:
            for dv in steps:
                grid = np.stack(np.meshgrid(columns + du, rows + dv), axis=-1)
                sight = np.concatenate([rays(camera, grid), np.ones((101, 101, 1))], axis=-1)
                cosine = sight @ center / np.linalg.norm(sight, axis=-1) / np.linalg.norm(center)
                total += np.sqrt(1 - cosine**2) * np.linalg.norm(center) <= target.disc_radius
        light[v - 50 : v + 51, u - 50 : u + 51] -= 0.7 * total / 36
    light = cv2.GaussianBlur(light, (0, 0), 0.7) + rng.normal(0, 0.005, light.shape)
    return np.clip(np.round(255 * light), 0, 255).astype(np.uint8)


def test_spheres_from_any_side(rng: np.random.Generator) -> None:
    balls = Target(FIVE.names, FIVE.points, 20.0)
    for tilt in (20, 110):
        T = pose(tilt, 30, xyz=(90, 40, 1100))
        pixels = truth(SMALL, balls.points, T)
        found = detect_target(SMALL, balls, render_spheres(SMALL, balls, T, rng), off(T, rng), shape="sphere")
        assert found.names == balls.names
        assert np.abs(found.pixels - pixels).max() < 0.03
        assert np.abs(found.bias_px).max() > 0.03


def test_images_that_cannot_be_used_are_named(rng: np.random.Generator) -> None:
    T = pose()
    image = render_discs(SMALL, TRIANGLE, T, rng)
    plate = render_discs(SMALL, TRIANGLE, pose(180 - 30, 20), rng)
    noise = rng.integers(100, 140, image.shape).astype(np.uint8)
    u, v = np.round(truth(SMALL, TRIANGLE.points, T)[0]).astype(int)
    painted = image.copy()
    cv2.circle(painted, (int(u), int(v)), 40, 217, -1)
    faint = render_discs(SMALL, TRIANGLE, T, rng, Look(black=0.5, white=0.515, background=0.5))
    soft = render_discs(SMALL, TRIANGLE, T, rng, Look(blur_px=7.0))
    for picture, failure in [
        (np.zeros_like(image), Failure.BLACK),
        (np.full_like(image, 200), Failure.LOW_CONTRAST),
        (np.full_like(image, 255), Failure.LOW_CONTRAST),
        (faint, Failure.LOW_CONTRAST),
        (soft, Failure.BLURRED),
        (plate, Failure.NO_DISCS),
        (painted, Failure.TOO_FEW),
        (image[:-2], Failure.WRONG_SIZE),
        (np.repeat(image[..., None], 3, axis=2), Failure.WRONG_IMAGE),
        (image / 255.0, Failure.WRONG_IMAGE),
    ]:
        assert refusal(picture, T).failure is failure
    assert refusal(noise, T).failure in (Failure.NO_DISCS, Failure.TOO_FEW, Failure.LOW_CONTRAST)


@pytest.mark.parametrize(
    ("T", "failure"),
    [
        (pose(150), Failure.BACK_SIDE),
        (pose(86), Failure.TOO_SMALL),
        (pose(xyz=(0, 0, 9000)), Failure.TOO_SMALL),
        (pose(xyz=(0, 0, -1000)), Failure.OUTSIDE),
        (pose(xyz=(600, 0, 1000)), Failure.OUTSIDE),
        (pose(20, 0, 0, xyz=(0, 218, 1000)), Failure.CUT),
        (pose(20, 0, 0, xyz=(-196, 0, 1000)), Failure.CUT),
    ],
    ids=["back", "edge-on", "far", "behind", "outside", "cut below", "cut left"],
)
def test_poses_that_cannot_be_seen_are_named(T: Float, failure: Failure, rng: np.random.Generator) -> None:
    image = render_discs(SMALL, TRIANGLE, T, rng, Look(background=0.8))
    assert refusal(image, T).failure is failure


@given(st.floats(0, 70), st.floats(0, 360), st.floats(-250, 250), st.floats(400, 3000), st.floats(2, 60))
def test_outline_of_a_disc_is_the_conic(tilt: float, around: float, x: float, z: float, radius: float) -> None:
    # without distortion the rim's image is the conic H^-T diag(1, 1, -r^2) H^-1, whose centre and area are known
    pinhole = Camera(2448, 2048, 4600.0, 4650.0, 1220.0, 1030.0)
    T = pose(tilt, around, xyz=(x, 50, z))
    outline = predict_outline(pinhole, T, np.zeros(3), np.array([0.0, 0, 1]), radius)
    assert outline is not None
    inverse = np.linalg.inv(pinhole.matrix @ T[:3, [0, 1, 3]])
    conic = inverse.T @ np.diag([1, 1, -(radius**2)]) @ inverse
    center = np.linalg.solve(conic[:2, :2], -conic[:2, 2])
    area = np.pi * -np.linalg.det(conic) / np.linalg.det(conic[:2, :2]) ** 1.5
    assert np.allclose(outline.centroid, center, atol=2e-3)
    assert outline.area == pytest.approx(area, rel=2e-3)
    assert np.allclose(outline.projected, truth(pinhole, np.zeros((1, 3)), T)[0], atol=1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(3, 8), st.integers(0, 4))
def test_labels_survive_shift_turn_and_clutter(seed: int, n: int, extra: int) -> None:
    rng = np.random.default_rng(seed)
    predicted = rng.uniform(0, 600, (n, 2))
    apart = np.linalg.norm(predicted[:, None] - predicted, axis=-1) + 1e9 * np.eye(n)
    corners = predicted[:3] - predicted[0]
    assume(apart.min() > 60 and abs(corners[1, 0] * corners[2, 1] - corners[1, 1] * corners[2, 0]) > 2e4)
    turn = Rotation.from_euler("z", rng.uniform(-3, 3), degrees=True).as_matrix()[:2, :2]
    true = (predicted - 300) @ turn.T * rng.uniform(0.97, 1.03) + 300 + rng.uniform(-40, 40, 2)
    order = rng.permutation(n)
    found = np.concatenate([true[order], rng.uniform(-2000, -1000, (extra, 2))])
    labelling = assign_labels(predicted, found, np.ones((n, n + extra), dtype=bool), 100.0)
    assert labelling is not None
    assert labelling.count == n
    assert labelling.blobs == tuple(int(i) for i in np.argsort(order))
