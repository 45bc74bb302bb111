"""Find a calibration board in grey images, to sub-pixel."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.errors import InputError
from symcal.vision.aprilgrid import find_aprilgrid
from symcal.vision.charuco import charuco_board
from symcal.vision.chessboard import find_chessboard, sub_pixel
from symcal.vision.circles import find_circles
from symcal.vision.images import Image, is_black, read_image

Float = NDArray[np.float64]

Fault = Literal["unreadable", "size", "black", "no board", "cut"]

_LEAST = 8  # corners of a partly seen board that still hold a pose and a hint of the intrinsics; ours


@dataclass(frozen=True, slots=True)
class BoardDetection:
    """The board's points in one image.

    Attributes:
        name: the image's. size: (width, height), px.
        indices: which of `Board.points`, shape (n,). pixels: where, shape (n, 2), px.
        radii: of the dots of a circle grid, in units of the spacing, shape (n,); None for other boards.
        blur_px: sigma of the edges of the squares or dots, px (NaN if it cannot be told).
        method: the detector that found it.
    """

    name: str
    size: tuple[int, int]
    indices: NDArray[np.intp]
    pixels: Float
    radii: Float | None
    blur_px: float
    method: str


@dataclass(frozen=True, slots=True)
class Refusal:
    """An image that gives no points, and why: the kind of fault, and a sentence."""

    name: str
    fault: Fault
    reason: str


def detect_boards(paths: Iterable[Path | str], board: Board) -> tuple[list[BoardDetection], list[Refusal]]:
    """Look for the board in image files; every file ends in exactly one of the two lists.

    The size that most images have is the camera's; images of another size are refused.

    Example:
        >>> import cv2
        >>> import numpy as np
        >>> import symcal as sc
        >>> squares = np.indices((7, 10)).sum(axis=0) % 2 * 255
        >>> image = np.pad(np.kron(squares, np.ones((40, 40))), 60, constant_values=255)
        >>> cv2.imwrite("board.png", image.astype(np.uint8))
        True
        >>> found, refused = sc.detect_boards(["board.png"], sc.parse_board("chessboard:9x6:25mm"))
        >>> len(found), len(refused)
        (1, 0)
    """
    images: list[tuple[str, Image]] = []
    refusals: list[Refusal] = []
    for path in paths:
        try:
            images.append((Path(path).name, read_image(path)))
        except InputError as error:
            cut = error.message.startswith("the image is cut")
            refusals.append(Refusal(Path(path).name, "cut" if cut else "unreadable", error.message))
    shapes = [image.shape for _, image in images]
    usual = max(dict.fromkeys(shapes), key=shapes.count, default=(0, 0))
    detections: list[BoardDetection] = []
    for name, image in images:
        if image.shape != usual:
            sizes = f"{image.shape[1]} x {image.shape[0]} px, the others {usual[1]} x {usual[0]} px"
            refusals.append(Refusal(name, "size", f"the image has another size than the others: {sizes}"))
            continue
        found = detect_board(image, board, name)
        if isinstance(found, BoardDetection):
            detections.append(found)
        else:
            refusals.append(found)
    return detections, refusals


def detect_board(image: Image, board: Board, name: str = "image") -> BoardDetection | Refusal:
    """The board's points in one image, or why there are none.

    Chessboards: the classic detector, then the sector-based one [Duda2018], both ending in a gradient-based corner
    refinement whose window stays clear of the neighbouring corners. ChArUco boards and AprilTag grids may be seen in
    part.

    Args:
        image: grey, shape (height, width).
        board: what to look for.
        name: of the image, for messages.
    """
    size = (image.shape[1], image.shape[0])
    if is_black(image):
        level = f"its brightest pixels reach {np.percentile(image, 99.9):.0f} of 255"
        return Refusal(name, "black", f"the image is black: {level}")
    radii = None
    if board.kind in ("charuco", "aprilgrid"):
        find = _find_charuco if board.kind == "charuco" else find_aprilgrid
        method, indices, pixels = find(image, board)
        if len(indices) < _LEAST or _in_a_line(board, indices):
            seen = f"{len(indices)} corners of the board are seen" if len(indices) else "no marker of the board is seen"
            return Refusal(name, "no board", f"{seen}: at least {_LEAST}, not all in one row, are needed")
    elif board.kind == "chessboard":
        method, pixels = find_chessboard(image, board)
        indices = np.flatnonzero(np.isfinite(pixels[:, 0]))
        pixels = pixels[indices]
    else:
        dots = find_circles(image, board)
        method, indices, pixels = "none", np.empty(0, dtype=np.intp), np.empty((0, 2))
        if dots is not None and len(dots.indices) >= max(_LEAST, len(board.points) // 2):
            method, indices, pixels, radii = dots.method, dots.indices, dots.centroids, dots.radii
    if not len(indices):
        what = "circles" if "circles" in board.kind else "inner corners"
        reason = (
            f"no board with {board.columns} x {board.rows} {what} is seen whole (it may be cut off, blurred or hidden)"
        )
        return Refusal(name, "no board", reason)
    return BoardDetection(name, size, indices, pixels, radii, _edge_blur(image, board, indices, pixels), method)


def _find_charuco(image: Image, board: Board) -> tuple[str, NDArray[np.intp], Float]:
    for method, legacy in (("charuco", False), ("charuco, layout before OpenCV 4.6", True)):
        if legacy and board.rows % 2:
            break
        corners, numbers, _, _ = cv2.aruco.CharucoDetector(charuco_board(board, legacy)).detectBoard(image)
        if numbers is not None and len(numbers) >= _LEAST:
            order = np.argsort(np.ravel(numbers))
            indices = np.ravel(numbers)[order].astype(np.intp)
            found = np.asarray(corners, dtype=np.float64).reshape(-1, 2)[order]
            window = _charuco_window(board, indices, found)
            return (
                method,
                np.ravel(numbers)[order].astype(np.intp),
                sub_pixel(image, found, window),
            )
    return "none", np.empty(0, dtype=np.intp), np.empty((0, 2))


def _charuco_window(board: Board, indices: NDArray[np.intp], pixels: Float) -> int:
    """Half window of the refinement: 5, or less where the corners of the markers would come into it."""
    pairs = _neighbours(board, indices)
    if not len(pairs) or board.marker is None:
        return 2
    spacing = float(np.linalg.norm(pixels[pairs[:, 0]] - pixels[pairs[:, 1]], axis=1).min())
    return max(2, min(5, int(spacing * (board.square - board.marker) / (2 * board.square))))


def _in_a_line(board: Board, indices: NDArray[np.intp]) -> bool:
    points = board.points[indices, :2]
    return bool(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] < 1e-6)


def _neighbours(board: Board, indices: NDArray[np.intp]) -> NDArray[np.intp]:
    """Pairs of detected points that are next to each other on the board, as positions in `indices`, shape (m, 2)."""
    points = board.points[indices, :2]
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    pitch = board.square * (np.sqrt(2) if board.kind == "asymmetric_circles" else 1)
    return np.argwhere(np.triu(np.abs(distance - pitch) < 1e-6 * pitch))


def _edge_blur(image: Image, board: Board, indices: NDArray[np.intp], pixels: Float) -> float:
    """Sigma of the blur, px: a step blurred by a Gaussian has its range / steepest slope = sigma sqrt(2 pi).

    Profiles across the edge half-way between neighbouring corners (from centre to centre of neighbouring dots) are
    averaged before the slope is taken, so that noise does not pass for sharpness. Ours.
    """
    pairs = _neighbours(board, indices)
    if not len(pairs):
        return float("nan")
    a, b = pixels[pairs[:, 0]], pixels[pairs[:, 1]]
    length = np.linalg.norm(b - a, axis=1)
    dots = "circles" in board.kind
    share = 0.25 if dots else 0.3 if board.dictionary is None else 0.12
    half = float(np.clip(share * np.median(length), 3.0, 25.0))
    offsets = np.arange(-half, half + 0.125, 0.25)
    along = (b - a) / length[:, None]
    across = along if dots else np.stack([-along[:, 1], along[:, 0]], axis=1)
    middle = (a + (b - a) * 0.25) if dots else (a + b) / 2
    where = (middle[:, None] + offsets[:, None] * across[:, None, :]).astype(np.float32)
    u, v = where[..., 0], where[..., 1]
    profiles = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
    profiles *= np.sign(profiles[:, -1:] - profiles[:, :1])
    # Edges of dots are not exactly at the middle of the profile: align each at its own half level.
    profiles = np.array([_aligned(profile) for profile in profiles])
    mean = np.nanmean(profiles, axis=0)
    slope = np.diff(mean).max() / 0.25
    return float(np.ptp(mean) / slope / np.sqrt(2 * np.pi)) if slope > 0 else float("nan")


def _aligned(profile: Float) -> Float:
    """The profile shifted so that its half level is at the middle sample (whole samples; ends repeated)."""
    level = (profile[0] + profile[-1]) / 2
    crossing = int(np.argmax(profile > level)) if profile[-1] > profile[0] else len(profile) // 2
    shift = crossing - len(profile) // 2
    return profile[np.clip(np.arange(len(profile)) + shift, 0, len(profile) - 1)]
