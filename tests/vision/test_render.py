"""Rendered images against OpenCV's projection, and against what light must do."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from board_scenes import placed, seen
from scipy.spatial.transform import Rotation

from symcal.camera.board import parse_board
from symcal.camera.camera import Camera, project_points
from symcal.camera.target import Target
from symcal.vision.render import Look, render_board, render_discs

CAMERAS = {
    "pinhole": Camera(800, 600, 700.0, 700.0, 399.5, 299.5),
    "barrel": Camera(800, 600, 600.0, 601.0, 410.0, 290.0, (-0.35, 0.13, 0.001, -0.002)),
    "pincushion": Camera(800, 600, 900.0, 900.0, 380.0, 310.0, (0.2, -0.05)),
}
CLEAN = Look(black=0.0, white=1.0, background=0.5, blur_px=0.0, noise=0.0)
TILT = Rotation.from_rotvec([0.4, -0.5, 0.2])


@pytest.mark.parametrize("name", CAMERAS)
def test_corners_are_where_opencv_projects_them(name: str, rng: np.random.Generator) -> None:
    camera, board = CAMERAS[name], parse_board("chessboard:7x5:30mm")
    view = placed(TILT, board.points.mean(axis=0), np.array([0.15, -0.1]), 520.0)
    image = render_board(camera, board, view, rng, Look(noise=0.0))
    turn, shift = Rotation.from_matrix(view[:3, :3]).as_rotvec(), view[:3, 3]
    expected, _ = cv2.projectPoints(board.points, turn, shift, camera.matrix, np.array(camera.dist))
    start = expected.astype(np.float32) + np.float32(0.8)
    found = cv2.cornerSubPix(image, start, (6, 6), (-1, -1), (cv2.TERM_CRITERIA_EPS, 100, 1e-5))
    # The gradient refinement itself is biased by perspective and curvature within its window: that is its share.
    assert np.sqrt(np.mean(np.sum((found - expected) ** 2, axis=-1))) < 0.04


def centroid(polygon: np.ndarray) -> tuple[float, np.ndarray]:
    """Area and centroid of a polygon, shape (n, 2)."""
    start = polygon - polygon.mean(axis=0)
    end = np.roll(start, -1, axis=0)
    cross = start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]
    moment = ((start + end) * cross[:, None]).sum(axis=0)
    return abs(cross.sum()) / 2, polygon.mean(axis=0) + moment / (3 * cross.sum())


@pytest.mark.parametrize("name", CAMERAS)
def test_discs_are_where_their_rims_project(name: str, rng: np.random.Generator) -> None:
    camera, target = CAMERAS[name], Target.triangle(120.0, 12.0)
    view = placed(Rotation.from_rotvec([np.pi, 0, 0]) * TILT, np.zeros(3), np.array([-0.1, 0.12]), 450.0)
    image = render_discs(camera, target, view, rng, CLEAN, discs="black", margin=30.0)
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    rim = target.disc_radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    for centre in target.points:
        edge = project_points(camera, (centre + rim) @ view[:3, :3].T + view[:3, 3])
        area, true = centroid(edge)
        (u0, v0), (u1, v1) = np.floor(edge.min(axis=0)).astype(int) - 2, np.ceil(edge.max(axis=0)).astype(int) + 3
        ink = 1 - image[v0:v1, u0:u1] / 255
        u, v = np.meshgrid(np.arange(u0, u1), np.arange(v0, v1))
        assert ink.sum() == pytest.approx(area, rel=1e-3)
        found = np.array([(ink * u).sum(), (ink * v).sum()]) / ink.sum()
        assert np.abs(found - true).max() < 3e-3


@pytest.mark.parametrize("kind", ["circles:6x5:30mm", "asymmetric_circles:3x7:20mm"])
def test_every_dot_of_a_grid_is_printed_once(kind: str, rng: np.random.Generator) -> None:
    camera, board = CAMERAS["barrel"], parse_board(kind)
    view = placed(TILT, board.points.mean(axis=0), np.zeros(2), 420.0)
    image = render_board(camera, board, view, rng, CLEAN)
    count, _, _, centroids = cv2.connectedComponentsWithStats((image < 60).astype(np.uint8))
    assert count - 1 == len(board.points)
    distance = np.linalg.norm(centroids[1:, None] - seen(camera, board, view), axis=-1)
    assert distance.min(axis=0).max() < 1.0


def test_a_charuco_board_is_that_of_opencv(rng: np.random.Generator) -> None:
    board = parse_board("charuco:5x4:20mm:15mm:DICT_5X5_50")
    camera = Camera(500, 400, 1000.0, 1000.0, 249.5, 199.5)
    view = np.eye(4)
    view[:3, 3] = [-50, -40, 200]  # five pixels per mm, the board just filling the image
    image = render_board(camera, board, view, rng, CLEAN)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_50)
    expected = cv2.aruco.CharucoBoard((5, 4), 20.0, 15.0, dictionary).generateImage((500, 400))
    # OpenCV's picture may be off by a pixel at edges, so compare where it is even.
    even = cv2.dilate(expected, np.ones((5, 5))) == cv2.erode(expected, np.ones((5, 5)))
    assert even.mean() > 0.4
    assert np.array_equal(image[even], expected[even])


def test_the_same_seed_gives_the_same_image() -> None:
    camera, board = CAMERAS["barrel"], parse_board("chessboard:7x5:30mm")
    view = placed(TILT, board.points.mean(axis=0), np.zeros(2), 500.0)
    images = [render_board(camera, board, view, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert np.array_equal(images[0], images[1])
    assert not np.array_equal(images[0], images[2])


def test_noise_blur_and_vignetting_have_the_stated_size(rng: np.random.Generator) -> None:
    camera, board = CAMERAS["pinhole"], parse_board("chessboard:7x5:30mm")
    away = np.eye(4)
    away[2, 3] = -500.0  # behind the camera: background only
    flat = render_board(camera, board, away, rng, Look(background=0.5, noise=0.02, blur_px=0.0)) / 255
    assert flat.mean() == pytest.approx(0.5, abs=1e-3)
    assert flat.std() == pytest.approx(np.hypot(0.02, 1 / 255 / np.sqrt(12)), rel=0.02)
    dark = render_board(camera, board, away, rng, Look(background=0.5, noise=0.0, vignetting=0.4)) / 255
    assert dark[0, 0] == pytest.approx(0.5 * 0.6, abs=3e-3)
    assert dark[299, 399] == pytest.approx(0.5, abs=3e-3)

    # The edge of a square, blurred: its steepest slope is range / (sigma sqrt(2 pi)).
    front = np.eye(4)
    front[:3, 3] = [0, 0, 300]
    look = Look(black=0.0, white=1.0, blur_px=2.0, noise=0.0)
    row = render_board(camera, board, front, rng, look)[335, 390:450].astype(float) / 255
    sigma = np.hypot(2.0, 1 / np.sqrt(12))
    assert np.abs(np.diff(row)).max() == pytest.approx(1 / (sigma * np.sqrt(2 * np.pi)), rel=0.05)


def test_the_back_of_a_target_shows_no_disc(rng: np.random.Generator) -> None:
    camera, target = CAMERAS["pinhole"], Target.triangle(120.0, 12.0)
    back = placed(TILT, np.zeros(3), np.zeros(2), 450.0)
    image = render_discs(camera, target, back, rng, CLEAN)
    assert image.max() == 255
    assert image.min() > 100


def test_the_marked_disc_has_a_hole(rng: np.random.Generator) -> None:
    camera, target = CAMERAS["pinhole"], Target.triangle(120.0, 12.0, marked="P2")
    view = placed(Rotation.from_rotvec([np.pi, 0, 0]), np.zeros(3), np.zeros(2), 450.0)
    image = render_discs(camera, target, view, rng, CLEAN)
    centres = np.rint(project_points(camera, target.points @ view[:3, :3].T + view[:3, 3])).astype(int)
    assert [int(image[v, u]) for u, v in centres] == [0, 255, 0]


def test_discs_out_of_plane_have_their_own_plates_and_hide_what_is_behind(rng: np.random.Generator) -> None:
    corners = np.array([[60.0, 0, 0], [-60, 60, 0], [-60, -60, 40], [60, 0, 100]])
    target = Target(("A", "B", "C", "D"), corners, 10.0)
    camera = CAMERAS["pinhole"]
    view = placed(Rotation.from_rotvec([np.pi, 0, 0]), np.zeros(3), np.zeros(2), 600.0)
    image = render_discs(camera, target, view, rng, CLEAN, discs="white", margin=5.0)
    points = target.points @ view[:3, :3].T + view[:3, 3]
    centres = np.rint(project_points(camera, points)).astype(int)
    assert [int(image[v, u]) for u, v in centres[1:]] == [255, 255, 255]
    # D stands in front of A and covers it in part; the plate of D is black next to its disc.
    u, v = centres[3]
    radius = camera.fx * 10.0 / points[3, 2]
    assert image[v, int(u + 1.25 * radius)] == 0


def test_a_view_beyond_the_fold_of_the_lens_is_background(rng: np.random.Generator) -> None:
    camera = Camera(800, 600, 300.0, 300.0, 399.5, 299.5, (-0.35,))
    board = parse_board("chessboard:7x5:300mm")
    view = placed(Rotation.identity(), board.points.mean(axis=0), np.zeros(2), 400.0)
    image = render_board(camera, board, view, rng, CLEAN)
    assert set(np.unique(image[:20, :20])) == {128}
    assert image[299, 399] in (0, 255)
