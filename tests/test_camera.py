"""The camera model against OpenCV, against its own inverse, and at its edges; targets and boards."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from symcal.camera.board import Board, parse_board
from symcal.camera.camera import INTRINSIC_NAMES, Camera, fold_radius, in_image, project, project_points, rays
from symcal.camera.reproject import moved, reproject
from symcal.camera.target import Target
from symcal.errors import InputError
from symcal.instruments.registry import Pixels
from symcal.vision.precision import projected, projection_jacobian

CAMERAS = {
    "pinhole": Camera(640, 480, 530.0, 531.0, 342.0, 233.0),
    "barrel": Camera(640, 480, 530.0, 531.0, 342.0, 233.0, (-0.28, 0.02, 0.001, -0.0001, 0.16)),
    "strong barrel": Camera(1280, 960, 800.0, 802.0, 650.0, 470.0, (-0.35, 0.13)),
    "pincushion": Camera(2448, 2048, 4638.0, 4638.0, 1223.5, 1023.5, (0.2, 0.1, -0.001, 0.002)),
    "folding": Camera(640, 480, 300.0, 300.0, 320.0, 240.0, (-0.35,)),
}


def points(rng: np.random.Generator, count: int) -> np.ndarray:
    z = rng.uniform(300, 3000, count)
    return np.column_stack([rng.uniform(-0.4, 0.4, (count, 2)) * z[:, None], z])


@pytest.mark.parametrize("name", CAMERAS)
def test_projections_agree_with_opencv(name: str, rng: np.random.Generator) -> None:
    camera, cloud = CAMERAS[name], points(rng, 50)
    expected, jacobian = cv2.projectPoints(cloud, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.dist))
    assert project_points(camera, cloud) == pytest.approx(expected[:, 0], abs=1e-9)

    p, k = ca.SX.sym("p", 3), ca.SX.sym("k", 9)
    pixel = project(p, k)
    symbolic = ca.Function("project", [p, k], [pixel, ca.jacobian(pixel, p), ca.jacobian(pixel, k)])
    for i, point in enumerate(cloud[:10]):
        value, by_point, by_intrinsics = (np.array(part) for part in symbolic(point, camera.intrinsics))
        assert value.ravel() == pytest.approx(expected[i, 0], abs=1e-9)
        rows = slice(2 * i, 2 * i + 2)
        assert by_point == pytest.approx(jacobian[rows, 3:6], rel=1e-9, abs=1e-9)
        assert by_intrinsics == pytest.approx(jacobian[rows, 6:15], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", CAMERAS)
def test_rays_undo_the_projection(name: str) -> None:
    camera = CAMERAS[name]
    u, v = np.meshgrid(np.linspace(-0.5, camera.width - 0.5, 21), np.linspace(-0.5, camera.height - 0.5, 17))
    pixels = np.stack([u, v], axis=-1)
    ray = rays(camera, pixels)
    back = project_points(camera, np.concatenate([ray, np.ones_like(ray[..., :1])], axis=-1))
    seen = np.isfinite(ray[..., 0])
    assert back[seen] == pytest.approx(pixels[seen], abs=1e-9)
    assert seen.all() == (name != "folding")


def test_a_lens_that_folds_shows_each_point_once() -> None:
    camera = CAMERAS["folding"]
    radius = fold_radius(camera)
    assert radius == pytest.approx(1 / np.sqrt(3 * 0.35))
    reach = np.linspace(0, 2 * radius, 400)
    pixels = project_points(camera, np.column_stack([reach, np.zeros_like(reach), np.ones_like(reach)]))
    assert np.array_equal(np.isfinite(pixels[:, 0]), reach < radius)
    assert np.all(np.diff(pixels[reach < radius, 0]) > 0)
    edge = camera.cx + camera.fx * radius * (1 - 0.35 * radius**2)
    assert np.isnan(rays(camera, np.array([edge + 1, camera.cy]))).all()
    assert np.isfinite(rays(camera, np.array([edge - 1, camera.cy]))).all()


def test_nothing_behind_the_camera_is_seen() -> None:
    camera = CAMERAS["pinhole"]
    pixels = project_points(camera, np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    assert np.isnan(pixels[:2]).all()
    assert pixels[2] == pytest.approx([camera.cx, camera.cy])
    assert in_image(camera, pixels).tolist() == [False, False, True]


@given(st.floats(-0.5, 639.5), st.floats(-0.5, 479.5), st.floats(0, 100))
def test_the_image_ends_half_a_pixel_beyond_the_outer_centres(u: float, v: float, margin: float) -> None:
    camera = CAMERAS["pinhole"]
    distance = min(u + 0.5, v + 0.5, 639.5 - u, 479.5 - v)
    assume(margin == 0 or abs(distance - margin) > 1e-9)  # rounding decides there
    inside = distance >= margin
    assert in_image(camera, np.array([u, v]), margin) == inside


def test_missing_coefficients_are_zero_and_wrong_numbers_are_refused() -> None:
    assert Camera(10, 10, 1.0, 1.0, 0.0, 0.0, (0.1,)).dist == (0.1, 0.0, 0.0, 0.0, 0.0)
    assert len(INTRINSIC_NAMES) == len(CAMERAS["barrel"].intrinsics)
    with pytest.raises(InputError, match="distortion"):
        Camera(10, 10, 1.0, 1.0, 0.0, 0.0, (0.0,) * 8)
    with pytest.raises(InputError, match="fx"):
        Camera(10, 10, -1.0, 1.0, 0.0, 0.0)
    with pytest.raises(InputError, match="9 x 9"):
        Camera(10, 10, 1.0, 1.0, 0.0, 0.0, covariance=np.eye(4))


def test_a_triangle_has_its_side_and_its_centre() -> None:
    target = Target.triangle(200.0, 15.0)
    sides = np.linalg.norm(target.points - np.roll(target.points, 1, axis=0), axis=1)
    assert sides == pytest.approx([200.0] * 3)
    assert target.points.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    a, b, c = target.points
    assert np.cross(b - a, c - a)[2] > 0
    assert target.names == ("P1", "P2", "P3")


def test_a_target_needs_three_named_points() -> None:
    with pytest.raises(InputError, match="three points"):
        Target(("A", "A", "B"), np.eye(3), 1.0)
    with pytest.raises(InputError, match="one finite point"):
        Target(("A", "B", "C"), np.eye(4), 1.0)
    with pytest.raises(InputError, match="no disc of this name"):
        Target.triangle(100.0, 10.0, marked="P4")


def test_chessboard_points_are_inner_corners() -> None:
    board = parse_board("chessboard:9x6:25mm")
    assert board.points.shape == (54, 3)
    assert board.points[0].tolist() == [0, 0, 0]
    assert board.points[10].tolist() == [25, 25, 0]
    assert str(board) == "chessboard:9x6:25mm"


def test_charuco_points_are_those_of_opencv() -> None:
    board = parse_board("charuco:5x7:3cm:22mm:DICT_4X4_50")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    expected = cv2.aruco.CharucoBoard((5, 7), 30.0, 22.0, dictionary).getChessboardCorners()
    assert board.points == pytest.approx(np.array(expected), abs=1e-5)


def test_asymmetric_rows_are_shifted_by_one_spacing() -> None:
    board = parse_board("asymmetric_circles:4x11:20mm")
    assert board.points[:2, :2].tolist() == [[0, 0], [40, 0]]
    assert board.points[4:6, :2].tolist() == [[20, 20], [60, 20]]


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("chessboard:9x6:25", "unit"),
        ("chess:9x6:25mm", "unknown kind"),
        ("chessboard:9:25mm", "COLUMNSxROWS"),
        ("chessboard:9x1:25mm", "too few"),
        ("charuco:5x7:30mm", "marker"),
        ("charuco:5x7:30mm:31mm:DICT_4X4_50", "smaller"),
        ("chessboard:9x6:25mm:10mm:DICT_4X4_50", "charuco"),
        ("chessboard:9x6:0mm", "positive"),
    ],
)
def test_wrong_boards_are_named(text: str, word: str) -> None:
    with pytest.raises(InputError, match=word):
        parse_board(text)


@given(
    st.sampled_from(["chessboard", "circles", "asymmetric_circles"]),
    st.integers(3, 30),
    st.integers(3, 30),
    st.integers(1, 400),
)
def test_a_board_reads_back_from_its_text(kind: str, columns: int, rows: int, tenths: int) -> None:
    board = parse_board(f"{kind}:{columns}x{rows}:{tenths / 10}mm")
    assert isinstance(board, Board)
    assert parse_board(str(board)) == board


SKEWED = Camera(1280, 960, 800.0, 802.0, 650.0, 470.0, (-0.2, 0.08, 1e-3, -2e-3, 0.01), skew=3.0)


def test_a_skew_reaches_every_projection(rng: np.random.Generator) -> None:
    """What y adds to u, beside OpenCV's projection, which has none: numeric, symbolic, its inverse and derivatives."""
    cloud, plain = points(rng, 40), replace(SKEWED, skew=0.0)
    expected = project_points(plain, cloud)
    expected[:, 0] += 3.0 * (expected[:, 1] - SKEWED.cy) / SKEWED.fy
    pixels = project_points(SKEWED, cloud)
    assert pixels == pytest.approx(expected, abs=1e-9)
    assert rays(SKEWED, pixels) == pytest.approx(cloud[:, :2] / cloud[:, 2:], abs=1e-9)
    seen, by_pose = reproject(SKEWED, np.eye(4), cloud)
    assert seen == pytest.approx(expected, abs=1e-9)
    step = 1e-5
    for axis in range(6):
        increment = np.eye(6)[axis] * step
        ends = [reproject(SKEWED, moved(np.eye(4), sign * increment), cloud)[0] for sign in (1, -1)]
        assert by_pose[..., axis] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5, abs=1e-4)
    p, k = ca.SX.sym("p", 3), ca.SX.sym("k", 10)
    symbolic = ca.Function("project", [p, k], [project(p, k)])
    for point, pixel in zip(cloud, expected, strict=True):
        assert np.array(symbolic(point, SKEWED.numbers)).ravel() == pytest.approx(pixel, abs=1e-9)
    assert SKEWED.matrix @ [0.1, 0.2, 1] == pytest.approx([650 + 80 + 0.6, 470 + 160.4, 1])


@pytest.mark.parametrize("skew", [0.0, 3.0])
def test_derivatives_of_the_adjustment_are_those_of_its_projection(skew: float, rng: np.random.Generator) -> None:
    camera, cloud = replace(SKEWED, skew=skew), points(rng, 12)
    pose = (np.array([0.1, -0.2, 0.05]), np.array([10.0, -5.0, 400.0]))
    x = np.concatenate([*pose, camera.numbers])
    jacobian = projection_jacobian(camera, pose, cloud)
    for i in range(16):
        step = 1e-6 * max(1.0, abs(x[i]))
        ends = []
        for sign in (1, -1):
            y = x.copy()
            y[i] += sign * step
            ends.append(projected(camera.with_numbers(y[6:]), (y[:3], y[3:6]), cloud).ravel())
        slope = (ends[0] - ends[1]) / (2 * step)
        assert jacobian[:, i] == pytest.approx(slope, rel=1e-5, abs=1e-4 * max(1.0, np.abs(slope).max()))


def test_a_skew_is_no_number_of_a_camera_that_has_none() -> None:
    names = [p.name for p in Pixels(CAMERAS["strong barrel"]).unknowns("")[0]]
    assert names == list(INTRINSIC_NAMES)
    assert Pixels(CAMERAS["strong barrel"]).own == INTRINSIC_NAMES
    assert [p.name for p in Pixels(SKEWED).unknowns("")[0]] == [*INTRINSIC_NAMES, "skew"]
    held = replace(SKEWED, covariance=np.diag([1.0] * 9))
    assert [p.name for p in Pixels(held).unknowns("")[0]] == list(INTRINSIC_NAMES)
    told = replace(SKEWED, skew=0.0, covariance=np.diag([1.0] * 8 + [0.0, 0.01]))
    assert [p.name for p in Pixels(told).unknowns("")[0]] == [*INTRINSIC_NAMES[:-1], "skew"]


def test_the_pixel_instrument_honours_the_skew(rng: np.random.Generator) -> None:
    """Readings and both derivatives, against the numeric projection and finite differences."""
    kind = Pixels(SKEWED)
    rotation, point, reading, own = ca.SX.sym("r", 3, 3), ca.SX.sym("p", 3), ca.SX.sym("z", 2), ca.SX.sym("o", 10)
    by_twist, by_own = kind.slopes(rotation, point, reading, own)
    predict = kind.predict(rotation, point, own)
    call = ca.Function("pixels", [rotation, point, reading, own], [predict, by_twist, by_own])
    for place in points(rng, 5):
        value, slope, by_numbers = (np.array(part) for part in call(np.eye(3), place, np.zeros(2), SKEWED.numbers))
        assert value.ravel() == pytest.approx(project_points(SKEWED, place), abs=1e-9)
        for axis in range(3):
            step = np.eye(3)[axis] * 1e-4
            ends = [project_points(SKEWED, place + sign * step) for sign in (1, -1)]
            assert slope[:, 3 + axis] == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-5, abs=1e-6)
        for i in range(10):
            step = 1e-5 * np.eye(10)[i]
            ends = [project_points(SKEWED.with_numbers(SKEWED.numbers + sign * step), place) for sign in (1, -1)]
            assert by_numbers[:, i] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-5, abs=1e-5)
