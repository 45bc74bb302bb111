"""Which board an image shows, where it is not the one that it is said to be: another size, or another dictionary."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.vision.aprilgrid import BORDER_BITS
from symcal.vision.charuco import charuco_board
from symcal.vision.chessboard import resized, unscaled
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
_SMALL = 1600  # px; smaller images of tags are searched at double size
_COLUMNS = range(3, 41)
_OFF = 0.1  # of a square: rms by which markers may be off where their board would have them


def other_size(image: Image, board: Board) -> str | None:
    """What board the image shows; None if it is the one said, or none can be told (circles)."""
    if board.kind == "chessboard":
        return _other_chessboard(image, board)
    return _other_coded(image, board) if board.kind in ("charuco", "aprilgrid") else None


def _other_chessboard(image: Image, board: Board) -> str | None:
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, _, grid = cv2.findChessboardCornersSBWithMeta(image, _SMALLEST, flags)
    if not found or {*grid.shape[:2]} == {board.columns, board.rows}:
        return None
    return f"a chessboard of {max(grid.shape[:2])} x {min(grid.shape[:2])} inner corners"


def _other_coded(image: Image, board: Board) -> str | None:
    corners, numbers = _markers(image, board)
    if len(numbers) < _MARKERS:
        return _other_dictionary(image, board) if board.kind == "charuco" else None
    centres = corners.mean(axis=1)
    off = {columns: _misfit(board, columns, centres, numbers) for columns in _COLUMNS}
    columns = min(off, key=off.__getitem__)
    if columns == board.columns or off[columns] > _OFF or off.get(board.columns, np.inf) < 2 * off[columns]:
        return None
    if board.kind == "aprilgrid":
        return f"a grid of {columns} AprilTags a row and at least {numbers.max() // columns + 1} rows"
    rows = int(np.ceil(2 * (numbers.max() + 1) / columns))
    return f"a ChArUco board of {columns} squares a row and at least {rows} rows"


def _markers(image: Image, board: Board) -> tuple[Float, NDArray[np.intp]]:
    """Corners (n, 4, 2), px, and numbers (n,) of the markers in an image."""
    parameters = cv2.aruco.DetectorParameters()
    factor = 1.0
    if board.kind == "aprilgrid":  # whose corners touch the squares between the tags in small images
        parameters.markerBorderBits = BORDER_BITS
        factor = 0.5 if max(image.shape) < _SMALL else 1.0
    detector = cv2.aruco.ArucoDetector(marker_dictionary(board), parameters)
    corners, numbers, _ = detector.detectMarkers(resized(image, 1 / factor))
    if numbers is None:
        return np.empty((0, 4, 2)), np.empty(0, dtype=np.intp)
    return unscaled(corners, factor).reshape(-1, 4, 2), np.ravel(numbers).astype(np.intp)


def _misfit(board: Board, columns: int, centres: Float, numbers: NDArray[np.intp]) -> float:
    """Rms by which the markers are off from a board of so many columns, seen by any camera without distortion; in
    squares."""
    best = np.inf
    for places in _layouts(board, columns, int(numbers.max())):
        if any(int(number) not in places for number in numbers):
            continue
        plane = np.array([places[int(number)] for number in numbers])
        homography, _ = cv2.findHomography(centres, plane, 0)
        if homography is None:
            continue
        mapped = cv2.perspectiveTransform(centres[:, None], homography)[:, 0]
        best = min(best, float(np.sqrt(np.mean(np.sum((mapped - plane) ** 2, axis=1)))))
    return best


def _layouts(board: Board, columns: int, last: int) -> list[dict[int, Float]]:
    """Where the middles of the markers of a board of so many columns are, by number, in squares or tags."""
    if board.gap is not None:
        pitch = 1 + board.gap / board.square
        return [{n: pitch * np.array([n % columns, n // columns], dtype=np.float64) for n in range(last + 1)}]
    rows = int(np.ceil(2 * (last + 1) / columns)) + 1
    made = []
    for legacy in (False, True):
        # any dictionary will do that has enough markers: only their places are asked for
        made_of = replace(board, columns=columns, rows=rows + rows % 2, dictionary="DICT_4X4_1000")
        printed = charuco_board(made_of, legacy)
        middles = [np.asarray(corners)[:, :2].mean(axis=0) / board.square for corners in printed.getObjPoints()]
        made.append(dict(zip((int(number) for number in printed.getIds()), middles, strict=True)))
    return made


def _other_dictionary(image: Image, board: Board) -> str | None:
    """Markers of another dictionary, named by the smallest that has them all."""
    found: dict[str, NDArray[np.intp]] = {}
    for name in _LARGEST:
        if name != board.dictionary:
            found[name] = _markers(image, replace(board, columns=2, rows=2, dictionary=name))[1]
    name = max(found, key=lambda name: len(found[name]))
    if len(found[name]) < _MARKERS:
        return None
    family, _, size = name.rpartition("_")
    least = next((n for n in _SIZES if n > found[name].max()), None) if size == "1000" else None
    return f"markers of {name if least is None else f'{family}_{least}'}"
