"""A board as it is printed: black rectangles and discs on white paper, the same pattern that `detect_board` expects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.vision.aprilgrid import tag_bits
from symcal.vision.charuco import charuco_markers
from symcal.vision.patterns import dot_radius

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Artwork:
    """Black shapes on paper, x to the right and y down from the upper left of the pattern, mm.

    Attributes:
        width, height: of the pattern, mm.
        rectangles: left, top, width and height of each, shape (n, 4). discs: centre and radius of each, shape (m, 3).
        points: where `Board.points` are on the paper, shape (k, 2).
    """

    width: float
    height: float
    rectangles: Float
    discs: Float
    points: Float


def artwork(board: Board) -> Artwork:
    """The shapes of a board.

    Raises:
        InputError: an unknown dictionary of markers, or one that is too small.
    """
    points = board.points[:, :2] * [1, board.facing * -1]  # y of a board that looks along +z is upwards
    if board.dictionary is None and board.kind != "chessboard":
        radius = dot_radius(board)
        margin, rectangles, discs = radius, np.empty((0, 4)), np.column_stack([points, np.full(len(points), radius)])
    else:
        squares = {"chessboard": _chessboard, "charuco": _charuco, "aprilgrid": _aprilgrid}[board.kind](board)
        margin, rectangles, discs = board.gap or board.square, squares, np.empty((0, 3))
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    return Artwork(
        width=float(high[0] - low[0]),
        height=float(high[1] - low[1]),
        rectangles=rectangles - [*low, 0, 0],
        discs=discs - [*low, 0],
        points=points - low,
    )


def _chessboard(board: Board) -> Float:
    cells = [(x, y) for y in range(-1, board.rows) for x in range(-1, board.columns) if (x + y) % 2 == 0]
    return board.square * np.array([(x, y, 1, 1) for x, y in cells], dtype=np.float64)


def _charuco(board: Board) -> Float:
    markers = charuco_markers(board)
    side = board.marker or board.square
    inset = (board.square - side) / 2
    out = [
        board.square * np.array([[x, y, 1, 1]])
        for y in range(board.rows)
        for x in range(board.columns)
        if (x, y) not in markers
    ]
    out += [_black(bits, x * board.square + inset, y * board.square + inset, side) for (x, y), bits in markers.items()]
    return np.concatenate(out)


def _aprilgrid(board: Board) -> Float:
    gap, side = board.gap or 0.0, board.square
    pitch = side + gap
    out = [
        _black(tag_bits(board, number), number % board.columns * pitch, -(number // board.columns) * pitch - side, side)
        for number in range(board.columns * board.rows)
    ]
    crossings = [(x, y) for y in range(board.rows + 1) for x in range(board.columns + 1)]
    out.append(np.array([(x * pitch - gap, -y * pitch, gap, gap) for x, y in crossings]))
    return np.concatenate(out)


def _black(bits: NDArray[np.bool_], left: float, top: float, side: float) -> Float:
    """The black runs of every row of a marker, shape (n, 4)."""
    size = side / len(bits)
    runs = []
    for row, white in enumerate(bits):
        edges = np.flatnonzero(np.diff(np.concatenate([[True], white, [True]]).astype(int)))
        runs += [(left + a * size, top + row * size, (b - a) * size, size) for a, b in edges.reshape(-1, 2)]
    return np.array(runs, dtype=np.float64)
