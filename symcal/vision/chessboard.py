"""Inner corners of a chessboard: two detectors, sub-pixel refinement, a check of each against its neighbours."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.vision.images import Image

Float = NDArray[np.float64]

_LARGE = 1600  # px; longer images are first searched at half size, where the classic detector is more robust and quick
_SMALL = 1000  # px; shorter images are also searched at double size, for far boards
# A corner is not believed when it is farther than both limits from what any of its neighbours predict.
_STRAY_PX, _STRAY_MEDIANS = 2.0, 8.0
_WINDOW_SHARE, _WINDOW_CAP = 0.4, 9  # half window of the refinement: share of the smallest spacing, px at most


def find_chessboard(image: Image, board: Board) -> tuple[str, Float]:
    """Sub-pixel corners in the order of `Board.points`; the classic detector first, then the sector-based one.

    Args:
        image: grey, shape (height, width).
        board: of kind chessboard.
    Returns:
        method; corners, shape (n, 2), px, NaN where one cannot be trusted; shape (0, 2) if the board is not seen whole.
    Source: findChessboardCorners and findChessboardCornersSB [Duda2018] of OpenCV; scales, window and check are ours.
    """
    size = (board.columns, board.rows)
    classic = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    sector = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    plain, half, double = ("", 1.0), (" at half size", 2.0), (" at double size", 0.5)
    large, small = max(image.shape) > _LARGE, max(image.shape) < _SMALL
    for suffix, factor in (half, plain) if large else (plain,):
        found, corners = cv2.findChessboardCorners(resized(image, 1 / factor), size, flags=classic)
        if found:
            return f"classic{suffix}", _refined(image, board, _ordered(image, board, unscaled(corners, factor)))
    for suffix, factor in (plain, double) if small else (plain,):
        found, corners = cv2.findChessboardCornersSB(resized(image, 1 / factor), size, flags=sector)
        if found:
            return f"sector-based{suffix}", _refined(image, board, _ordered(image, board, unscaled(corners, factor)))
    return "none", np.empty((0, 2))


def sub_pixel(image: Image, corners: Float, half_window: int) -> Float:
    """Corners moved to where the grey gradients in a square window around them point, shape (n, 2), px."""
    if half_window < 1:
        return corners
    points = np.ascontiguousarray(corners, dtype=np.float32).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    refined = cv2.cornerSubPix(image, points, (half_window, half_window), (-1, -1), criteria)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2)


def resized(image: Image, factor: float) -> Image:
    """The image at so many times its size."""
    if factor == 1:
        return image
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, None, fx=factor, fy=factor, interpolation=method), dtype=np.uint8)


def unscaled(corners: object, factor: float) -> Float:
    """Corners of a scaled image in the original one: pixel centres are whole numbers in both."""
    return (np.asarray(corners, dtype=np.float64).reshape(-1, 2) + 0.5) * factor - 0.5


def _ordered(image: Image, board: Board, corners: Float) -> Float:
    """Corners in one order for all views: unmirrored, and the square between the first four black.

    The second rule decides only if the colours change by half a turn: columns plus rows odd.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    right, down = grid[:, -1].mean(axis=0) - grid[:, 0].mean(axis=0), grid[-1].mean(axis=0) - grid[0].mean(axis=0)
    if right[0] * down[1] - right[1] * down[0] < 0:
        grid = grid[:, ::-1]
    centres = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    u, v = np.rint(centres).astype(int).reshape(-1, 2).T
    inside = np.clip(v, 0, image.shape[0] - 1), np.clip(u, 0, image.shape[1] - 1)
    grey = image[inside].reshape(centres.shape[:2]).astype(float)
    odd = np.indices(grey.shape).sum(axis=0) % 2 == 1
    if grey[odd].mean() < grey[~odd].mean() and (board.columns + board.rows) % 2:
        grid = grid[::-1, ::-1]
    return grid.reshape(-1, 2)


def _refined(image: Image, board: Board, corners: Float) -> Float:
    """Refined corners; one that its neighbours contradict starts again where they expect it, then becomes NaN."""
    expected, _ = _strays(board, corners)
    grid = expected.reshape(board.rows, board.columns, 2)
    spacing = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min()) for axis in (0, 1))
    half_window = min(_WINDOW_CAP, int(_WINDOW_SHARE * spacing))
    result = sub_pixel(image, expected, half_window)
    expected, strays = _strays(board, result)
    if strays.any():
        result[strays] = sub_pixel(image, expected[strays], half_window)
        _, strays = _strays(board, result)
        result[strays] = np.nan
    return result


def _strays(board: Board, corners: Float) -> tuple[Float, NDArray[np.bool_]]:
    """Corners as their neighbours predict them, and which ones are far from every such prediction.

    Predictions run along the row and along the column, exact for quadratics: from both sides, from the left, from the
    right. One bad neighbour spoils some of them only, so that a good corner always has a good one.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    guesses = np.stack([guess for axis in (0, 1) for guess in _predictions(grid, axis)]).reshape(-1, len(corners), 2)
    distance = np.linalg.norm(guesses - corners, axis=-1)
    known = np.isfinite(distance)
    nearest = np.where(known, distance, np.inf).min(axis=0)
    strays = known.any(axis=0) & (nearest > max(_STRAY_PX, _STRAY_MEDIANS * float(np.median(nearest))))
    expected = corners.copy()
    expected[strays] = np.nanmedian(guesses[:, strays], axis=0)
    return expected, strays


def _predictions(grid: Float, axis: int) -> list[Float]:
    """Each corner from its neighbours along an axis: those before, those after, those on both sides; NaN at borders."""
    padded = np.pad(grid, [(3, 3) if a == axis else (0, 0) for a in range(3)], constant_values=np.nan)
    count = grid.shape[axis]

    def shifted(step: int) -> Float:
        return np.take(padded, np.arange(3 + step, 3 + step + count), axis=axis)

    before = 3 * shifted(-1) - 3 * shifted(-2) + shifted(-3)
    after = 3 * shifted(1) - 3 * shifted(2) + shifted(3)
    between = (4 * (shifted(-1) + shifted(1)) - shifted(-2) - shifted(2)) / 6
    return [before, after, between]
