"""A `Board` of kind charuco as OpenCV's own object, with its dictionary looked up by name."""

from __future__ import annotations

from typing import Any

import cv2

from symcal.camera.board import Board
from symcal.errors import InputError


def charuco_board(board: Board, legacy: bool = False) -> Any:
    """OpenCV's CharucoBoard, in mm.

    Args:
        board: of kind charuco.
        legacy: the layout of boards with an even number of rows that were printed with OpenCV before 4.6.
    Raises:
        InputError: no such dictionary, or the board needs more markers than it has.
    """
    dictionary = charuco_dictionary(board)
    marker = float(board.marker or 0.0)
    needed = board.columns * board.rows // 2
    if needed > len(dictionary.bytesList):
        message = f"this board needs {needed} markers, more than its dictionary has"
        raise InputError(message, key="board", found=f"{board.dictionary}, {len(dictionary.bytesList)} markers")
    result = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, marker, dictionary)
    result.setLegacyPattern(legacy)
    return result


def charuco_dictionary(board: Board) -> Any:
    """OpenCV's predefined dictionary of the board's name."""
    names = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
    if board.dictionary not in names:
        raise InputError("unknown dictionary of markers", key="board", found=board.dictionary, allowed=names)
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
