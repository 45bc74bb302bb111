"""Dots of a circle grid: found as blobs, refined as grey centroids; and the bias of a centroid in perspective."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.camera.board import Board
from symcal.camera.camera import Camera, project_points
from symcal.vision.images import Image
from symcal.vision.lattice import order_blobs

Float = NDArray[np.float64]

_LARGE = 1600  # px; longer images are searched at reduced size first
_RIM = 128  # points on a dot's rim for its area centroid: exact to 1e-4 px


@dataclass(frozen=True, slots=True)
class Dots:
    """Dots of a grid in one image.

    Attributes:
        method: how they were found.
        indices: which of `Board.points`, shape (n,); dots that touch the image's border or hide are left out.
        centroids: shape (n, 2), px.
        radii: in units of `Board.square`, shape (n,).
    """

    method: str
    indices: NDArray[np.intp]
    centroids: Float
    radii: Float


def find_circles(image: Image, board: Board) -> Dots | None:
    """The dots of a circle grid, or None when the grid is not seen.

    Args:
        image: grey, dark dots on a light board or the reverse.
        board: circles or asymmetric_circles.
    """
    grid = cv2.CALIB_CB_ASYMMETRIC_GRID if board.kind == "asymmetric_circles" else cv2.CALIB_CB_SYMMETRIC_GRID
    factor = int(np.ceil(max(image.shape) / _LARGE))
    small = (
        image if factor == 1 else cv2.resize(image, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
    )
    for colour, picture in (("dark", small), ("light", 255 - small)):
        detector = _blob_detector(picture.shape, board)
        for method in ("grid", "grid by clusters", "lattice"):
            if method == "lattice":
                blobs = np.array([blob.pt for blob in detector.detect(picture)], dtype=np.float64).reshape(-1, 2)
                centres = order_blobs(blobs, board)
            else:
                flags = grid | (cv2.CALIB_CB_CLUSTERING if method == "grid by clusters" else 0)
                size = (board.columns, board.rows)
                found, corners = cv2.findCirclesGrid(picture, size, flags=flags, blobDetector=detector)
                centres = np.asarray(corners, dtype=np.float64).reshape(-1, 2) if found else None
            if centres is not None:
                start = (centres + 0.5) * factor - 0.5
                pixels, radii = _centroids(image if colour == "dark" else 255 - image, board, start)
                whole = np.flatnonzero(radii > 0)
                return Dots(f"{method}, {colour} dots", whole, pixels[whole], radii[whole])
    return None


def dot_bias(camera: Camera, board: Board, T_camera_board: Float, indices: NDArray[np.intp], radius: float) -> Float:
    """Centroid of a dot's image minus the image of its centre, shape (n, 2), px.

    The centroid is that of the area inside the imaged rim, distortion included.

    Args:
        camera: numbers and distortion.
        board: a circle grid.
        T_camera_board: shape (4, 4), mm.
        indices: which points, shape (n,).
        radius: of the dots, mm.
    """
    angle = 2 * np.pi * np.arange(_RIM) / _RIM
    rim = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(_RIM)], axis=1)
    points = board.points[indices]
    both = np.concatenate([points[:, None], points[:, None] + rim], axis=1)
    pixels = project_points(camera, both @ T_camera_board[:3, :3].T + T_camera_board[:3, 3])
    edge = pixels[:, 1:] - pixels[:, :1]
    following = np.roll(edge, -1, axis=1)
    cross = edge[..., 0] * following[..., 1] - edge[..., 1] * following[..., 0]
    moment = ((edge + following) * cross[..., None]).sum(axis=1) / 3
    return np.asarray(moment / cross.sum(axis=1)[:, None], dtype=np.float64)


def _blob_detector(shape: tuple[int, ...], board: Board) -> Any:
    """Blobs from a few pixels up to the largest dot that leaves room for the grid (by default they end at 80 px)."""
    parameters: Any = cv2.SimpleBlobDetector.Params()
    parameters.minArea = 12.0
    parameters.maxArea = float(shape[0] * shape[1]) / (board.columns * board.rows)
    parameters.minDistBetweenBlobs = 3.0
    parameters.filterByCircularity = False
    return cv2.SimpleBlobDetector.create(parameters)


def _centroids(image: Image, board: Board, start: Float) -> tuple[Float, Float]:
    """Grey centroids inside ellipses that follow the perspective; radii in units of the spacing, 0 if cut."""
    plane = board.points[:, :2] / board.square
    homography = np.asarray(cv2.findHomography(plane, start)[0], dtype=np.float64)
    pitch = math.sqrt(2) if board.kind == "asymmetric_circles" else 1.0
    pixels, radii = start.copy(), np.zeros(len(start))
    for i, point in enumerate(plane):
        local = _slope(homography, point)
        to_unit = np.asarray(np.linalg.inv(local * (0.48 * pitch)), dtype=np.float64)
        for _ in range(3):
            pixels[i], area = _centroid(image, pixels[i], to_unit)
            radii[i] = np.sqrt(area / np.pi / abs(np.linalg.det(local)))
        reach = radii[i] * np.linalg.norm(local, axis=1) + 2.0
        if np.any(pixels[i] < reach) or np.any(pixels[i] > np.array(image.shape[::-1]) - 1 - reach):
            radii[i] = 0.0
    return pixels, radii


def _slope(homography: Float, point: Float) -> Float:
    """Derivative of the image point by the plane point, shape (2, 2)."""
    u, v, w = homography @ [*point, 1.0]
    return np.asarray((homography[:2, :2] - np.outer([u / w, v / w], homography[2, :2])) / w, dtype=np.float64)


def _centroid(image: Image, centre: Float, to_unit: Float) -> tuple[Float, float]:
    """Centroid and area of the dark dot inside the ellipse |to_unit (p - centre)| <= 1; the start if none is seen."""
    reach = np.linalg.norm(np.linalg.inv(to_unit), axis=1)
    (u0, v0), (u1, v1) = np.floor(centre - reach).astype(int), np.ceil(centre + reach).astype(int) + 1
    u0, v0, u1, v1 = max(u0, 0), max(v0, 0), min(u1, image.shape[1]), min(v1, image.shape[0])
    patch = image[v0:v1, u0:u1].astype(np.float64)
    u, v = np.meshgrid(np.arange(u0, u1) - centre[0], np.arange(v0, v1) - centre[1])
    distance2 = (to_unit[0, 0] * u + to_unit[0, 1] * v) ** 2 + (to_unit[1, 0] * u + to_unit[1, 1] * v) ** 2
    inside = distance2 <= 1
    rim = inside & (distance2 > 0.88)
    if not rim.any():
        return centre, 0.0
    white, black = np.median(patch[rim]), np.percentile(patch[inside], 3)
    if white - black < 8:
        return centre, 0.0
    ink = np.where(inside, np.clip((white - patch) / (white - black), 0, 1.05), 0.0)
    ink[ink < 0.1] = 0.0  # the light ground's noise would pull towards the middle of the window
    area = float(ink.sum())
    return centre + np.array([(ink * u).sum(), (ink * v).sum()]) / area, area
