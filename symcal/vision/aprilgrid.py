"""A grid of AprilTags, laid out as Kalibr prints it: its tags as bits, and its corners in an image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.vision.chessboard import resized, sub_pixel, unscaled
from symcal.vision.images import Image
from symcal.vision.markers import marker_dictionary

Float = NDArray[np.float64]

BORDER_BITS = 2
"""Width of the black border of a tag as Kalibr prints it, and we with it; AprilTag's own and OpenCV's tags have 1."""

_LARGE = 1600  # px; images up to this size are searched at double size, where corners that touch come apart
_WINDOW_CAP = 9  # half window of the refinement, px at most
# A corner is not believed when it is farther than this from where the tags around it expect it (px; near tags under a
# strong lens are no plane: then a share of their side), or when more than a share of the grey gradients around it
# belong to no edge through it. Ours.
_STRAY_PX, _STRAY_SHARE = 1.0, 0.06
_DOUBT = 0.4


@dataclass(frozen=True, slots=True)
class _Tags:
    """Tags in an image: numbers, shape (n,), and corners in the order of OpenCV's detector, shape (n, 4, 2), px."""

    numbers: NDArray[np.intp]
    corners: Float


def tag_bits(board: Board, number: int) -> NDArray[np.bool_]:
    """White bits of a tag with its border, first row on top, as it stands on the board.

    OpenCV keeps the tags upside down: its picture of a tag is turned by 180 deg against AprilTag's and Kalibr's.
    """
    dictionary = marker_dictionary(board)
    side = dictionary.markerSize + 2 * BORDER_BITS
    image = cv2.aruco.generateImageMarker(dictionary, number, side, borderBits=BORDER_BITS)
    return np.asarray(np.rot90(image > 0, 2))


def corner_indices(board: Board, number: int) -> NDArray[np.intp]:
    """Of `Board.points`, the corners of a tag in the order of OpenCV's detector, shape (4,).

    OpenCV goes clockwise from the upper left of its own picture, which is the lower right of the tag on the board.
    """
    width = 2 * board.columns
    row, column = divmod(number, board.columns)
    low = 2 * row * width + 2 * column
    return np.array([low + 1, low, low + width, low + width + 1], dtype=np.intp)


def find_aprilgrid(image: Image, board: Board) -> tuple[str, NDArray[np.intp], Float]:
    """Sub-pixel corners of the tags that are seen; tags with the border of Kalibr first, then those of AprilTag's.

    Args:
        image: grey, shape (height, width).
        board: of kind aprilgrid.
    Returns:
        method; which of `Board.points`, shape (n,); corners, shape (n, 2), px.
    Source: the detector of ArUco markers of OpenCV; scales, start, window and check are ours.
    """
    for border, method in ((BORDER_BITS, "tags"), (1, "tags with a border of one bit")):
        tags = _tags(image, board, border)
        if len(tags.numbers) >= min(2, board.columns * board.rows):
            return method, *_corners(image, board, tags, border)
    return "none", np.empty(0, dtype=np.intp), np.empty((0, 2))


def _tags(image: Image, board: Board, border: int) -> _Tags:
    """Tags of the board that are seen once, and lie roughly in one plane."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border
    detector = cv2.aruco.ArucoDetector(marker_dictionary(board), parameters)
    found: dict[int, Float] = {}
    twice: set[int] = set()
    for factor in (1.0, 2.0) if max(image.shape) > _LARGE else (0.5, 1.0):
        corners, numbers, _ = detector.detectMarkers(resized(image, 1 / factor))
        seen: list[int] = [] if numbers is None else [int(number) for number in np.ravel(numbers)]
        twice |= {number for number in seen if seen.count(number) > 1}
        for number, quad in zip(seen, corners, strict=True):
            if number < board.columns * board.rows:
                found.setdefault(number, unscaled(quad, factor))
    kept = [number for number in sorted(found) if number not in twice]
    tags = _Tags(np.array(kept, dtype=np.intp), np.array([found[number] for number in kept]).reshape(-1, 4, 2))
    if len(kept) < 2:
        return tags
    reach = 0.5 * float(np.median(_sides(tags)))  # wide: the lens bends the plane
    points = np.concatenate([board.points[corner_indices(board, number), :2] for number in kept])
    plane, flat = cv2.findHomography(points, tags.corners.reshape(-1, 2), cv2.RANSAC, reach)
    if plane is None:
        return _Tags(tags.numbers[:0], tags.corners[:0])
    whole = np.asarray(flat).reshape(-1, 4).all(axis=1)
    return _Tags(tags.numbers[whole], tags.corners[whole])


def _corners(image: Image, board: Board, tags: _Tags, border: int) -> tuple[NDArray[np.intp], Float]:
    """Refined corners. Each starts twice: where the detector saw it, and where the tags around it expect it.

    The detector's corners lie outwards where tags touch the squares between them (among neighbours that cancels), and
    near tags under a strong lens are no plane: the better of the two ends counts, if it is a corner at all. The window
    stays clear of the bits inside the tag and of what is beyond the gap.
    """
    indices = np.concatenate([corner_indices(board, number) for number in tags.numbers])
    side = np.repeat(_sides(tags), 4)
    bits = marker_dictionary(board).markerSize + 2 * border
    clear = side * min((board.gap or 0.0) / board.square, border / bits)
    windows = np.clip(0.7 * clear - 1, 2, _WINDOW_CAP).astype(int)
    seen = tags.corners.reshape(-1, 2)
    expected = _expected(board, tags, seen, 0.15 * side[::4])
    starts = (seen, np.where(np.isnan(expected), seen, expected))
    ends = np.array([_refined(image, start, windows) for start in starts])
    doubts = np.array([[_doubt(image, *each) for each in zip(end, windows, strict=True)] for end in ends])
    better, each = doubts.argmin(axis=0), np.arange(len(seen))
    refined = ends[better, each]
    sound = doubts[better, each] < _DOUBT
    limit = np.maximum(_STRAY_PX, _STRAY_SHARE * side - _STRAY_PX)
    around = _expected(board, tags, np.where(sound[:, None], refined, seen), limit[::4])
    miss = np.linalg.norm(refined - around, axis=1)
    order = np.argsort(indices)
    order = order[(sound & (miss < limit))[order]]
    return indices[order], refined[order]


def _refined(image: Image, start: Float, windows: NDArray[np.intp]) -> Float:
    """Corners refined in windows of their own half sizes; NaN where the refinement left its window and gave up."""
    result = start.astype(np.float32).astype(np.float64)  # as OpenCV takes them, and gives them back then
    for window in np.unique(windows).tolist():
        own = windows == window
        ends = sub_pixel(image, result[own], window)
        result[own] = np.where(np.all(ends == result[own], axis=1, keepdims=True), np.nan, ends)
    return result


def _doubt(image: Image, pixel: Float, window: int) -> float:
    """Share of the grey gradients around a point that belong to no edge through it, 0 to 1; 1 at the border."""
    if np.isnan(pixel[0]):
        return 1.0
    u, v = np.rint(pixel).astype(int).tolist()
    low_u, low_v, high_u, high_v = u - window - 1, v - window - 1, u + window + 2, v + window + 2
    if low_u < 0 or low_v < 0 or high_u > image.shape[1] or high_v > image.shape[0]:
        return 1.0
    patch = image[low_v:high_v, low_u:high_u].astype(np.float64)
    by_u, by_v = (patch[1:-1, 2:] - patch[1:-1, :-2]), (patch[2:, 1:-1] - patch[:-2, 1:-1])
    steps = np.arange(-window, window + 1)
    along_u, along_v = steps + u - pixel[0], (steps + v - pixel[1])[:, None]
    across = np.sum((by_u * along_u + by_v * along_v) ** 2)
    whole = np.sum((by_u**2 + by_v**2) * (along_u**2 + along_v**2))
    return float(across / whole) if whole > 0 else 1.0


def _expected(board: Board, tags: _Tags, pixels: Float, tolerance: Float) -> Float:
    """Corners of every tag as the plane through it and the tags around it shows them, shape (4 n, 2); NaN if alone.

    Args:
        pixels: corners, shape (4 n, 2). tolerance: px beyond which one of them has no say, shape (n,).
    """
    row, column = np.divmod(tags.numbers, board.columns)
    points = np.concatenate([board.points[corner_indices(board, number), :2] for number in tags.numbers])
    result = np.full_like(pixels, np.nan)
    for i, reach in enumerate(tolerance.tolist()):
        near = np.repeat((np.abs(row - row[i]) <= 1) & (np.abs(column - column[i]) <= 1), 4)
        own = slice(4 * i, 4 * i + 4)
        if near.sum() == 4:
            continue
        plane, _ = cv2.findHomography(points[near], pixels[near], cv2.RANSAC, reach)
        if plane is not None:
            result[own] = cv2.perspectiveTransform(points[None, own], plane)[0]
    return result


def _sides(tags: _Tags) -> Float:
    """The shortest side of every tag, px."""
    return np.asarray(np.linalg.norm(np.diff(tags.corners, axis=1, append=tags.corners[:, :1]), axis=-1).min(axis=1))
