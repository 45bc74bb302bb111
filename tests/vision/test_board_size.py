"""Boards that are not those that they are said to be, and those that are."""

from __future__ import annotations

import numpy as np
import pytest
from board_scenes import board_views

from symcal.camera.board import parse_board
from symcal.camera.camera import Camera
from symcal.vision.board_size import other_size
from symcal.vision.render import Look, render_board

LENS = Camera(640, 480, 620.0, 621.0, 322.0, 238.0, (-0.2, 0.05))
CHARUCO = "charuco:12x9:30mm:22mm:DICT_4X4_100"
CHESSBOARD = "chessboard:9x6:30mm"
TAGS = "aprilgrid:5x4:40mm:10mm"


@pytest.fixture(scope="module", params=[CHARUCO, CHESSBOARD, TAGS])
def shown(request):
    rng = np.random.default_rng(2)
    board = parse_board(request.param)
    (view,) = board_views(LENS, board, 1, rng, share=0.7)
    return request.param, render_board(LENS, board, view, rng, Look(noise=0.008))


SAID = {
    CHARUCO: {
        "charuco:12x9:30mm:22mm:DICT_4X4_250": None,
        "charuco:12x8:30mm:22mm:DICT_4X4_100": None,  # its corners have the same numbers
        "charuco:11x9:30mm:22mm:DICT_4X4_100": "a ChArUco board of 12 squares a row and at least 9 rows",
        "charuco:9x12:30mm:22mm:DICT_4X4_100": "a ChArUco board of 12 squares a row and at least 9 rows",
        "charuco:12x9:30mm:22mm:DICT_5X5_100": "markers of DICT_4X4_100",
    },
    CHESSBOARD: {
        "chessboard:6x9:30mm": None,
        "chessboard:8x6:30mm": "a chessboard of 9 x 6 inner corners",
        "chessboard:11x8:30mm": "a chessboard of 9 x 6 inner corners",
    },
    TAGS: {
        "aprilgrid:5x4:30mm:10mm": None,  # the size of its tags is another matter
        "aprilgrid:6x4:40mm:10mm": "a grid of 5 AprilTags a row and at least 4 rows",
    },
}


def test_what_the_image_shows_is_said_where_it_is_another_board(shown):
    board, image = shown
    assert other_size(image, parse_board(board)) is None
    for said, expected in SAID[board].items():
        assert other_size(image, parse_board(said)) == expected, said


def test_of_circles_and_of_nothing_nothing_is_said():
    blank = np.full((480, 640), 200, dtype=np.uint8)
    for board in ("circles:7x6:20mm", CHARUCO, CHESSBOARD, TAGS):
        assert other_size(blank, parse_board(board)) is None
