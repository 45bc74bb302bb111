"""Flat printed patterns as exact functions of the plane.

A pattern maps coordinates x, y in mm (arrays of one shape) to 0 (black), 1 (white) or NaN (beside the plate).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from symcal.camera import Board, Target
from symcal.vision.charuco import charuco_board, charuco_dictionary

Float = NDArray[np.float64]
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
    """A board on a white plate with a margin of one square around it.

    Args:
        board: any kind.
        circle_radius: of the dots of a circle grid, mm; by default 0.3 of the distance between neighbours.
    """
    square = board.square
    points = board.points[:, :2]
    if board.kind in ("chessboard", "charuco"):
        points = np.concatenate([points - square, points + square])
    low, high = points.min(axis=0) - square, points.max(axis=0) + square
    if board.kind == "chessboard":
        face = _chessboard(board)
    elif board.kind == "charuco":
        face = _charuco(board)
    else:
        face = _circles(board, circle_radius)

    def pattern(x: Float, y: Float) -> Float:
        inside = (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
        return np.where(inside, face(x, y), np.nan)

    outline = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return Plate(np.eye(4), pattern, outline, facing=-1)


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
        column, row = np.floor(x / board.square), np.floor(y / board.square)
        inside = (column >= -1) & (column < board.columns) & (row >= -1) & (row < board.rows)
        return np.where(inside & ((column + row) % 2 == 0), 0.0, 1.0)

    return face


def _charuco(board: Board) -> Pattern:
    """Black squares, and in each white one its marker: a grid of bits in a black frame of one bit."""
    source, dictionary = charuco_board(board), charuco_dictionary(board)
    bits = dictionary.markerSize + 2
    corners = np.array(source.getObjPoints(), dtype=np.float64)[:, 0, :2]
    side = board.marker or board.square
    grid = np.zeros((board.rows, board.columns, bits, bits))
    for number, corner in zip(np.ravel(source.getIds()), corners, strict=True):
        column, row = np.floor((corner + side / 2) / board.square).astype(int)
        grid[row, column] = cv2.aruco.generateImageMarker(dictionary, int(number), bits, borderBits=1) / 255
        grid[row, column] += 2  # a white square: its marker's bits, and white around them

    def face(x: Float, y: Float) -> Float:
        column, row = np.floor(x / board.square).astype(int), np.floor(y / board.square).astype(int)
        inside = (column >= 0) & (column < board.columns) & (row >= 0) & (row < board.rows)
        column, row = np.where(inside, column, 0), np.where(inside, row, 0)
        margin = (board.square - side) / 2
        i = np.floor((x - column * board.square - margin) / side * bits).astype(int)
        j = np.floor((y - row * board.square - margin) / side * bits).astype(int)
        on_marker = (i >= 0) & (i < bits) & (j >= 0) & (j < bits)
        value = grid[row, column, np.clip(j, 0, bits - 1), np.clip(i, 0, bits - 1)]
        value = np.where(value < 2, 0.0, np.where(on_marker, value - 2, 1.0))
        return np.where(inside, value, 1.0)

    return face


def _circles(board: Board, radius: float | None) -> Pattern:
    skewed = board.kind == "asymmetric_circles"
    size = radius if radius is not None else 0.3 * board.square * (np.sqrt(2) if skewed else 1.0)

    def face(x: Float, y: Float) -> Float:
        black = np.zeros(np.shape(x), dtype=bool)
        nearest = np.clip(np.round(y / board.square), 0, board.rows - 1)
        for row in (nearest - 1, nearest, nearest + 1) if skewed else (nearest,):
            shift, pitch = (row % 2, 2) if skewed else (0, 1)
            column = np.clip(np.round((x / board.square - shift) / pitch), 0, board.columns - 1)
            distance = np.hypot(x - (pitch * column + shift) * board.square, y - row * board.square)
            black |= (distance <= size) & (row >= 0) & (row < board.rows)
        return np.where(black, 0.0, 1.0)

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
