"""Flat printed patterns as exact functions of the plane.

A pattern maps coordinates x, y in mm (arrays of one shape, float32 or float64) to 0 (black), 1 (white) or NaN (beside
the plate).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from symcal.camera.board import Board
from symcal.camera.target import Target
from symcal.vision.aprilgrid import tag_bits
from symcal.vision.charuco import charuco_markers

Float = NDArray[np.floating[Any]]
Pattern = Callable[[Float, Float], Float]


@dataclass(frozen=True, slots=True)
class Plate:
    """A flat plate with a pattern on one face.

    Attributes:
        T_frame_plate: pose of the plate in the board's or target's frame, shape (4, 4), mm.
        pattern: its printed face. facing: +1 if the face looks along the plate's +z, -1 if along -z.
        outline: convex polygon that holds the plate, shape (m, 2), mm.
    """

    T_frame_plate: Float
    pattern: Pattern
    outline: Float
    facing: int


def board_plate(board: Board, circle_radius: float | None = None) -> Plate:
    """A board on a white plate with a margin of one square around it (of a gap more for an AprilTag grid).

    Args:
        board: any kind.
        circle_radius: of the dots of a circle grid, mm; by default 0.3 of the distance between neighbours.
    """
    square = board.square
    points = board.points[:, :2]
    if board.kind in ("chessboard", "charuco"):
        points = np.concatenate([points - square, points + square])
    margin = square + (board.gap or 0.0)
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    if board.kind == "chessboard":
        face = _chessboard(board)
    elif board.kind == "charuco":
        face = _charuco(board)
    elif board.kind == "aprilgrid":
        face = _aprilgrid(board)
    else:
        face = _circles(board, circle_radius)

    def pattern(x: Float, y: Float) -> Float:
        inside = (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
        return np.where(inside, face(x, y), np.nan)

    outline = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return Plate(np.eye(4), pattern, outline, board.facing)


def target_plates(target: Target, black: bool, margin: float) -> list[Plate]:
    """The plates of a disc target: one if the discs lie in a plane, else a square one behind each disc.

    Args:
        target: discs and their normal.
        black: black discs on white plates, or the reverse.
        margin: between a disc and the edge of its plate, mm.
    """
    frame = np.eye(4)
    normal = np.array(target.normal)
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    frame[:3, :3] = np.stack(
        [side / np.linalg.norm(side), np.cross(normal, side) / np.linalg.norm(side), normal], axis=1
    )
    local = target.points @ frame[:3, :3]
    holes = np.array([name == target.marked for name in target.names])
    reach = target.disc_radius + margin
    if np.ptp(local[:, 2]) < 1e-6:
        frame[:3, 3] = normal * local[0, 2]
        hull = _grown_hull(local[:, :2], reach)
        return [Plate(frame, _discs(target, local[:, :2], holes, hull, black), hull, facing=1)]
    plates = []
    for point, centre, hole in zip(target.points, local, holes, strict=True):
        own = frame.copy()
        own[:3, 3] = point - frame[:3, :2] @ centre[:2]
        hull = centre[:2] + reach * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        plates.append(Plate(own, _discs(target, centre[None, :2], np.array([hole]), hull, black), hull, facing=1))
    return plates


def _chessboard(board: Board) -> Pattern:
    def face(x: Float, y: Float) -> Float:
        column, row = _cell(x / board.square), _cell(y / board.square)
        inside = (column >= -1) & (column < board.columns) & (row >= -1) & (row < board.rows)
        return np.where(inside & ((column ^ row) & 1 == 0), 0.0, 1.0)

    return face


def _cell(coordinate: Float) -> NDArray[np.int32]:
    """Number of the unit cell of a coordinate; far off and NaN count as one far cell."""
    return np.floor(np.clip(np.nan_to_num(coordinate, nan=1e6), -1e6, 1e6)).astype(np.int32)


def _charuco(board: Board) -> Pattern:
    """Black squares, and in each white one its marker: a grid of bits in a black frame of one bit."""
    markers = charuco_markers(board)
    bits, side = len(next(iter(markers.values()))), board.marker or board.square
    grid = np.zeros((board.rows, board.columns, bits, bits))
    for (column, row), white in markers.items():
        grid[row, column] = white + 2.0  # a white square: its marker's bits, and white around them

    def face(x: Float, y: Float) -> Float:
        column, row = _cell(x / board.square), _cell(y / board.square)
        inside = (column >= 0) & (column < board.columns) & (row >= 0) & (row < board.rows)
        column, row = np.where(inside, column, 0), np.where(inside, row, 0)
        margin = (board.square - side) / 2
        i = _cell((x - column * board.square - margin) / side * bits)
        j = _cell((y - row * board.square - margin) / side * bits)
        on_marker = (i >= 0) & (i < bits) & (j >= 0) & (j < bits)
        value = grid[row, column, np.clip(j, 0, bits - 1), np.clip(i, 0, bits - 1)]
        value = np.where(value < 2, 0.0, np.where(on_marker, value - 2, 1.0))
        return np.where(inside, value, 1.0)

    return face


def _aprilgrid(board: Board) -> Pattern:
    """Tags, y upwards, and black squares in the gaps at their corners, which make every corner a crossing."""
    tags = np.array([tag_bits(board, number)[::-1] for number in range(board.columns * board.rows)])
    bits, pitch = tags.shape[1], board.square + (board.gap or 0.0)

    def face(x: Float, y: Float) -> Float:
        column, row = _cell(x / pitch), _cell(y / pitch)
        i, j = _cell((x - column * pitch) / board.square * bits), _cell((y - row * pitch) / board.square * bits)
        crossing = (i >= bits) & (j >= bits) & (column >= -1) & (column < board.columns)
        crossing &= (row >= -1) & (row < board.rows)
        on_tag = (i < bits) & (j < bits) & (column >= 0) & (column < board.columns) & (row >= 0) & (row < board.rows)
        number = np.where(on_tag, row * board.columns + column, 0)
        white = tags[number, np.clip(j, 0, bits - 1), np.clip(i, 0, bits - 1)]
        return np.where(on_tag, np.where(white, 1.0, 0.0), np.where(crossing, 0.0, 1.0))

    return face


def dot_radius(board: Board) -> float:
    """Radius of the dots of a grid as it is printed: 0.3 of the distance between neighbours, mm."""
    return 0.3 * board.square * (np.sqrt(2) if board.kind == "asymmetric_circles" else 1.0)


def _circles(board: Board, radius: float | None) -> Pattern:
    skewed = board.kind == "asymmetric_circles"
    size = radius if radius is not None else dot_radius(board)

    def face(x: Float, y: Float) -> Float:
        # The nearest dot: of a square lattice, or of one turned by 45 deg, its axes along the sum and difference.
        u, v = x / board.square, y / board.square
        if skewed:
            along, across = np.round((u + v) / 2), np.round((u - v) / 2)
            column, row = along + across, along - across
        else:
            column, row = np.round(u), np.round(v)
        last = 2 * board.columns - 2 + row % 2 if skewed else board.columns - 1
        printed = (column >= 0) & (column <= last) & (row >= 0) & (row < board.rows)
        return np.where(printed & ((u - column) ** 2 + (v - row) ** 2 <= (size / board.square) ** 2), 0.0, 1.0)

    return face


def _discs(target: Target, centres: Float, holes: NDArray[np.bool_], hull: Float, black: bool) -> Pattern:
    edges = np.roll(hull, -1, axis=0) - hull
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)

    def face(x: Float, y: Float) -> Float:
        inside = np.ones(np.shape(x), dtype=bool)
        for corner, normal in zip(hull, outward, strict=True):
            inside &= (x - corner[0]) * normal[0] + (y - corner[1]) * normal[1] <= 0
        ink = np.zeros(np.shape(x), dtype=bool)
        for centre, hole in zip(centres, holes, strict=True):
            distance2 = (x - centre[0]) ** 2 + (y - centre[1]) ** 2
            disc = distance2 <= target.disc_radius**2
            ink |= disc & (distance2 > target.disc_radius**2 / 4) if hole else disc
        return np.where(inside, np.where(ink == black, 0.0, 1.0), np.nan)

    return face


def _grown_hull(points: Float, reach: float) -> Float:
    """Convex hull of squares of half side `reach` around the points, counter-clockwise, shape (m, 2)."""
    corners = (points[:, None] + reach * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])).reshape(-1, 2)
    return np.asarray(corners[ConvexHull(corners).vertices], dtype=np.float64)
