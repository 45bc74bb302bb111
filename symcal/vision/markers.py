"""The markers of a board: OpenCV's dictionary of its name."""

from __future__ import annotations

from typing import Any

import cv2

from symcal.camera.board import Board
from symcal.errors import InputError


def marker_dictionary(board: Board) -> Any:
    """OpenCV's predefined dictionary of the board's name.

    Raises:
        InputError: no such dictionary, or the board needs more markers than it has.
    """
    names = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
    if board.dictionary not in names:
        raise InputError("unknown dictionary of markers", key="board", found=board.dictionary, allowed=names)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    needed = board.columns * board.rows // (1 if board.kind == "aprilgrid" else 2)
    if needed > len(dictionary.bytesList):
        message = f"this board needs {needed} markers, more than its dictionary has"
        raise InputError(message, key="board", found=f"{board.dictionary}, {len(dictionary.bytesList)} markers")
    return dictionary
