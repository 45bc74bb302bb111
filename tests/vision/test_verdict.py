"""The verdict on a calibration names the fault that was built into the views, and no other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from board_scenes import board_views, placed, seen
from scipy.spatial.transform import Rotation

from symcal.camera.board import parse_board
from symcal.camera.camera import Camera
from symcal.vision.board import BoardDetection, Refusal
from symcal.vision.calibrate import calibrate_camera
from symcal.vision.verdict import Verdict, judge

CAMERA = Camera(1000, 800, 800.0, 801.0, 510.0, 390.0, (-0.25, 0.08))
BOARD = parse_board("chessboard:9x6:25mm")


def detections(views: list[np.ndarray], sigma: float, rng: np.random.Generator) -> list[BoardDetection]:
    result = []
    for i, view in enumerate(views):
        pixels = seen(CAMERA, BOARD, view)
        noise = sigma * rng.standard_normal(pixels.shape)
        result.append(
            BoardDetection(f"view {i}", (1000, 800), np.arange(len(pixels)), pixels + noise, None, 1.0, "exact")
        )
    return result


def verdict(views: list[np.ndarray], rng: np.random.Generator, sigma: float = 0.1) -> Verdict:
    return judge(calibrate_camera(detections(views, sigma, rng), BOARD))


def corner_views(rng: np.random.Generator) -> list[np.ndarray]:
    """Boards with a point in each corner of the image."""
    result = []
    while len(result) < 8:
        view = board_views(CAMERA, BOARD, 1, rng, margin=10.0)[0]
        u, v = seen(CAMERA, BOARD, view).T
        wanted = [(0, 0), (1000, 0), (0, 800), (1000, 800)][len(result) % 4]
        if np.any((abs(u - wanted[0]) < 150) & (abs(v - wanted[1]) < 120)):
            result.append(view)
    return result


def test_views_into_every_corner_are_good(rng: np.random.Generator) -> None:
    views = corner_views(rng) + board_views(CAMERA, BOARD, 6, rng)
    result = verdict(views, rng)
    assert result.grade == "good"
    assert result.findings == ()
    assert result.retake == ()
    assert "good enough" in result.summary


def test_uncovered_corners_are_named(rng: np.random.Generator) -> None:
    views = []
    while len(views) < 10:
        view = board_views(CAMERA, BOARD, 1, rng, share=0.4)[0]
        if seen(CAMERA, BOARD, view)[:, 0].max() < 600:
            views.append(view)
    result = verdict(views, rng)
    assert result.grade == "usable"
    assert any("top right" in finding and "bottom right" in finding for finding in result.findings)


def test_frontal_views_are_poor(rng: np.random.Generator) -> None:
    middle = BOARD.points.mean(axis=0)
    views = [
        placed(Rotation.from_rotvec(rng.normal(0, 0.03, 3)), middle, rng.uniform(-0.1, 0.1, 2), rng.uniform(400, 600))
        for _ in range(10)
    ]
    result = verdict(views, rng)
    assert result.grade == "poor"
    assert any("frontal" in finding for finding in result.findings)


def test_few_and_inexact_views_are_named(rng: np.random.Generator) -> None:
    views = board_views(CAMERA, BOARD, 5, rng)
    result = verdict(views, rng, sigma=1.5)
    assert result.grade == "poor"
    words = " ".join(result.findings)
    assert "only 5 views" in words
    assert "reprojection error" in words
    assert "focal length is only known" in words


def test_a_blurred_view_and_a_refused_image_are_to_be_retaken(rng: np.random.Generator) -> None:
    found = detections(board_views(CAMERA, BOARD, 9, rng), 0.1, rng)
    found[3] = replace(found[3], blur_px=4.0)
    refusal = Refusal("dark.png", "black", "the image is black")
    retake = dict(judge(calibrate_camera(found, BOARD, [refusal])).retake)
    assert set(retake) == {"dark.png", "view 3"}
    assert "blurred" in retake["view 3"]
