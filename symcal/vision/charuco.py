"""A `Board` of kind charuco as OpenCV's own object, and its markers as bits."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

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


def charuco_markers(board: Board) -> dict[tuple[int, int], NDArray[np.bool_]]:
    """White bits of every marker with its black border of one bit, by the column and row of its (white) square."""
    source, dictionary = charuco_board(board), marker_dictionary(board)
    middles = np.array(source.getObjPoints(), dtype=np.float64)[:, :, :2].mean(axis=1)
    bits = dictionary.markerSize + 2
    out = {}
    for number, middle in zip(np.ravel(source.getIds()), middles, strict=True):
        column, row = np.floor(middle / board.square).astype(int).tolist()
        out[column, row] = cv2.aruco.generateImageMarker(dictionary, int(number), bits, borderBits=1) > 0
    return out
