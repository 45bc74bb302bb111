"""Which board an image shows, where it is not the one that it is said to be: another size, or another dictionary."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.errors import InputError
from symcal.vision.charuco import charuco_board
from symcal.vision.images import Image
from symcal.vision.markers import marker_dictionary

Float = NDArray[np.float64]

_SMALLEST = (3, 3)  # inner corners that the search for larger patterns starts from
_MARKERS = 6  # that must be seen to tell a board by its markers
_SIZES = (50, 100, 250, 1000)
_LARGEST = (
    *(f"DICT_{n}X{n}_1000" for n in (4, 5, 6, 7)),
    "DICT_ARUCO_ORIGINAL",
    *(f"DICT_APRILTAG_{family}" for family in ("16h5", "25h9", "36h10", "36h11")),
)
_COLUMNS = range(3, 41)
_OFF = 0.1  # of a square: rms by which markers may be off where their board would have them


def other_size(image: Image, board: Board) -> str | None:
    """What board the image shows; None if it is the one said, or none can be told (circles)."""
    if board.kind == "chessboard":
        return _other_chessboard(image, board)
    return _other_charuco(image, board) if board.kind == "charuco" else None


def _other_chessboard(image: Image, board: Board) -> str | None:
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, _, grid = cv2.findChessboardCornersSBWithMeta(image, _SMALLEST, flags)
    if not found or {*grid.shape[:2]} == {board.columns, board.rows}:
        return None
    return f"a chessboard of {max(grid.shape[:2])} x {min(grid.shape[:2])} inner corners"


def _other_charuco(image: Image, board: Board) -> str | None:
    corners, numbers = _markers(image, marker_dictionary(board))
    if len(numbers) < _MARKERS:
        return _other_dictionary(image, board)
    centres = corners.mean(axis=1)
    off = {columns: _misfit(board, columns, centres, numbers) for columns in _COLUMNS}
    columns = min(off, key=off.__getitem__)
    if columns == board.columns or off[columns] > _OFF or off.get(board.columns, np.inf) < 2 * off[columns]:
        return None
    rows = int(np.ceil(2 * (numbers.max() + 1) / columns))
    return f"a ChArUco board of {columns} squares a row and at least {rows} rows"


def _markers(image: Image, dictionary: Any) -> tuple[Float, NDArray[np.intp]]:
    """Corners (n, 4, 2), px, and numbers (n,) of the markers in an image."""
    corners, numbers, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(image)
    if numbers is None:
        return np.empty((0, 4, 2)), np.empty(0, dtype=np.intp)
    return np.asarray(corners, dtype=np.float64).reshape(-1, 4, 2), np.ravel(numbers).astype(np.intp)


def _misfit(board: Board, columns: int, centres: Float, numbers: NDArray[np.intp]) -> float:
    """Rms by which the markers are off from a board of so many columns, seen by any camera without distortion; in
    squares."""
    rows = int(np.ceil(2 * (numbers.max() + 1) / columns)) + 1
    best = np.inf
    for legacy in (False, True):
        try:
            made = charuco_board(replace(board, columns=columns, rows=max(rows + rows % 2, 2)), legacy)
        except InputError:  # more markers than the dictionary has
            made = charuco_board(replace(board, columns=columns, rows=max(rows - 1, 2)), legacy)
        printed = zip(made.getIds(), made.getObjPoints(), strict=True)
        places = {int(number): np.asarray(corners)[:, :2].mean(axis=0) for number, corners in printed}
        if any(int(number) not in places for number in numbers):
            continue
        plane = np.array([places[int(number)] for number in numbers])
        homography, _ = cv2.findHomography(centres, plane, 0)
        if homography is None:
            continue
        mapped = cv2.perspectiveTransform(centres[:, None], homography)[:, 0]
        best = min(best, float(np.sqrt(np.mean(np.sum((mapped - plane) ** 2, axis=1)))) / board.square)
    return best


def _other_dictionary(image: Image, board: Board) -> str | None:
    """Markers of another dictionary, named by the smallest that has them all."""
    found: dict[str, NDArray[np.intp]] = {}
    for name in _LARGEST:
        if name != board.dictionary:
            found[name] = _markers(image, marker_dictionary(replace(board, dictionary=name)))[1]
    name = max(found, key=lambda name: len(found[name]))
    if len(found[name]) < _MARKERS:
        return None
    family, _, size = name.rpartition("_")
    least = next((n for n in _SIZES if n > found[name].max()), None) if size == "1000" else None
    return f"markers of {name if least is None else f'{family}_{least}'}"
