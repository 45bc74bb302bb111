"""A `Board` of kind charuco as OpenCV's own object."""

from __future__ import annotations

from typing import Any

import cv2

from symcal.camera.board import Board
from symcal.vision.markers import marker_dictionary


def charuco_board(board: Board, legacy: bool = False) -> Any:
    """OpenCV's CharucoBoard, in mm.

    Args:
        board: of kind charuco.
        legacy: the layout of boards with an even number of rows that were printed with OpenCV before 4.6.
    Raises:
        InputError: no such dictionary, or the board needs more markers than it has.
    """
    size, marker = (board.columns, board.rows), float(board.marker or 0.0)
    result = cv2.aruco.CharucoBoard(size, board.square, marker, marker_dictionary(board))
    result.setLegacyPattern(legacy)
    return result
