"""The pose of a board in one image against OpenCV and the truth, its uncertainty, and what it says of the lens."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from symcal.camera.board import Board, parse_board
from symcal.camera.board_pose import LEVER, board_pose
from symcal.camera.camera import Camera, project_points
from symcal.spatial import transform

LENS = Camera(640, 480, 620.0, 621.0, 322.0, 238.0, (-0.2, 0.05, 1e-3, -1e-3))
BOARD = parse_board("charuco:12x9:30mm:22mm")


def view(tilt: float, rng: np.random.Generator, depth: float = 600.0, board: Board = BOARD) -> np.ndarray:
    about = rng.uniform(0, 2 * np.pi)
    turn = Rotation.from_rotvec(tilt * np.array([np.cos(about), np.sin(about), 0.0])).as_matrix()
    return transform(turn, np.array([20.0, -10.0, depth]) - turn @ board.points.mean(axis=0))


def seen(camera: Camera, pose: np.ndarray, indices: np.ndarray, board: Board = BOARD) -> np.ndarray:
    return project_points(camera, board.points[indices] @ pose[:3, :3].T + pose[:3, 3])


def test_the_pose_is_that_of_opencv(rng):
    for _ in range(5):
        indices = np.sort(rng.permutation(len(BOARD.points))[:40])
        pixels = seen(LENS, view(0.5, rng), indices) + 0.1 * rng.normal(size=(40, 2))
        found = board_pose(LENS, BOARD, indices, pixels)
        turn, shift = found.poses[0][:3, :3], found.poses[0][:3, 3]
        start = (cv2.Rodrigues(turn)[0], shift[:, None].copy())
        refined = cv2.solvePnPRefineLM(
            BOARD.points[indices], pixels, LENS.matrix, np.array(LENS.dist), *start, (3, 100, 1e-14)
        )
        np.testing.assert_allclose(refined[1].ravel(), shift, atol=1e-4)
        np.testing.assert_allclose(cv2.Rodrigues(refined[0])[0], turn, atol=1e-7)


def test_its_uncertainty_is_the_scatter_of_repeated_views(rng):
    pose, indices = view(0.4, rng), np.arange(0, 88, 3)
    exact = seen(LENS, pose, indices)
    arms = BOARD.points.mean(axis=0) + np.vstack([np.zeros(3), LEVER * np.eye(3)])
    off, sigma = [], []
    for _ in range(200):
        found = board_pose(LENS, BOARD, indices, exact + 0.1 * rng.normal(size=exact.shape))
        there, here = (arms @ each[:3, :3].T + each[:3, 3] for each in (found.poses[0], pose))
        off.append(np.mean(np.sum((there - here) ** 2, axis=1)))
        sigma.append(found.sigma)
    assert np.mean(sigma) == pytest.approx(np.sqrt(np.mean(off)), rel=0.1)


def test_the_focal_length_of_a_tilted_view_is_told(rng):
    longer = replace(LENS, fx=1.1 * LENS.fx, fy=1.1 * LENS.fy)
    indices, ratios = np.arange(88), []
    for _ in range(30):
        pixels = seen(longer, view(0.5, rng), indices) + 0.05 * rng.normal(size=(88, 2))
        found = board_pose(LENS, BOARD, indices, pixels)
        assert found.focal_rms_px < 0.1 < 0.3 < found.rms_px
        ratios.append((found.focal - 1.1) / found.focal_sigma)
    assert np.abs(np.mean(ratios)) < 0.7
    assert 0.6 < np.std(ratios) < 1.5
    plain = replace(LENS, dist=())  # else the distortion tells it
    head_on = board_pose(plain, BOARD, indices, seen(replace(longer, dist=()), view(0.0, rng), indices))
    assert head_on.focal_sigma > 0.02


def test_a_small_far_board_has_two_poses_of_which_one_is_true(rng):
    board = parse_board("charuco:5x4:12mm:9mm")
    indices = np.arange(len(board.points))
    pose = view(0.35, rng, 1500.0, board)
    pixels = seen(LENS, pose, indices, board) + 0.05 * rng.normal(size=(len(indices), 2))
    found = board_pose(LENS, board, indices, pixels)
    assert len(found.poses) == 2
    turns = [np.rad2deg(np.arccos(np.clip((each[:3, 2] @ pose[:3, 2]), -1, 1))) for each in found.poses]
    assert min(turns) < 12 < max(turns)


def test_points_on_a_line_give_no_pose(rng):
    indices = np.arange(6)
    assert board_pose(LENS, BOARD, indices, seen(LENS, view(0.3, rng), indices)) is None
