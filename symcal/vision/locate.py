"""A disc target in an image about which nothing is known: all places and poses where it may be."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import Camera, project_points
from symcal.camera.p3p import solve_p3p_batch
from symcal.camera.target import Target
from symcal.spatial import transform
from symcal.vision.discs import Blob, find_blobs
from symcal.vision.failures import Failure, NotDetected
from symcal.vision.search import LEAST_CONTRAST
from symcal.vision.target import grey_levels

Float = NDArray[np.float64]

_SMALLEST_PX = 5.0  # smaller semi-axis of a disc's image
_LARGEST = 0.2  # of the image's smaller side
_MOST_BLOBS = 8  # of one colour, the best ellipses
_SIZES = 0.6, 1.6  # area of a blob over that of the disc at a pose
_NEAR_PX = 12.0  # of a further disc from where a pose has it


@dataclass(frozen=True, slots=True)
class Guess:
    """One way to see the target in an image.

    pixels: of its discs, roughly, shape (n, 2), px; NaN for one that was not found. T_camera_target: shape (4, 4), mm.
    """

    pixels: Float
    T_camera_target: Float


def locate_target(camera: Camera, target: Target, image: NDArray[np.generic]) -> list[Guess]:
    """Every pose at which blobs of the image can be the target's discs, by place and size.

    Three equal discs can be told apart by nothing: each of three labellings has its own poses.

    Raises:
        NotDetected: with the named reason.
    """
    grey = grey_levels(camera, image)
    areas = np.pi * _SMALLEST_PX**2, np.pi * (_LARGEST * min(camera.width, camera.height)) ** 2
    blobs = find_blobs(grey, (0, 0, camera.width, camera.height), areas, LEAST_CONTRAST)
    if len(blobs) < 3:
        raise NotDetected(Failure.NO_DISCS, f"{len(blobs)} blobs in the whole image look like discs")
    guesses = [
        guess
        for bright in (False, True)
        for guess in _guesses(camera, target, [blob for blob in blobs if blob.bright == bright][:_MOST_BLOBS])
    ]
    if not guesses:
        raise NotDetected(Failure.TOO_FEW, f"{len(blobs)} blobs look like discs, but no three of them like the target")
    most = max(int(np.isfinite(guess.pixels[:, 0]).sum()) for guess in guesses)
    return [guess for guess in guesses if np.isfinite(guess.pixels[:, 0]).sum() == most]


def _guesses(camera: Camera, target: Target, blobs: list[Blob]) -> list[Guess]:
    base = max(combinations(range(len(target.names)), 3), key=lambda b: _area(target.points[list(b)]))
    marks = [target.names[i] == target.marked for i in base]
    triples = [
        triple
        for triple in permutations(range(len(blobs)), 3)
        if target.marked is None or [blobs[k].hole for k in triple] == marks
    ]
    if not triples:
        return []
    centers = np.array([blob.center for blob in blobs])
    pixels = centers[np.array(triples)]
    anywhere = np.broadcast_to(transform(np.eye(3), np.array([0.0, 0.0, 1e3])), (len(triples), 4, 4))
    results = solve_p3p_batch(camera, target.points[list(base)], pixels, anywhere, normal=np.array(target.normal))
    found = []
    for triple, result in zip(triples, results, strict=True):
        for pose in () if result is None else result.solutions:
            if _fits_sizes(camera, target, list(base), [blobs[k] for k in triple], pose):
                found.append(Guess(_completed(camera, target, list(base), triple, centers, pose), pose))
    return found


def _fits_sizes(camera: Camera, target: Target, base: list[int], blobs: list[Blob], pose: Float) -> bool:
    """Whether the blobs have the sizes of discs: pi r^2 fx fy (n . p) / z^3 px^2 for a small one at p with normal n."""
    points = target.points[base] @ pose[:3, :3].T + pose[:3, 3]
    slant = np.abs(points @ (pose[:3, :3] @ np.array(target.normal)))
    areas = np.pi * target.disc_radius**2 * camera.fx * camera.fy * slant / points[:, 2] ** 3
    ratio = np.array([blob.area for blob in blobs]) / areas
    return bool(np.all((ratio > _SIZES[0]) & (ratio < _SIZES[1])))


def _completed(
    camera: Camera, target: Target, base: list[int], triple: tuple[int, ...], centers: Float, pose: Float
) -> Float:
    """Image points of all discs: the further ones from the blobs nearest to where the pose has them."""
    pixels = np.full((len(target.names), 2), np.nan)
    pixels[base] = centers[list(triple)]
    expected = project_points(camera, target.points @ pose[:3, :3].T + pose[:3, 3])
    free = [k for k in range(len(centers)) if k not in triple]
    for i in range(len(target.names)):
        if i not in base and free and np.isfinite(expected[i]).all():
            distance = np.linalg.norm(centers[free] - expected[i], axis=1)
            if distance.min() < _NEAR_PX:
                pixels[i] = centers[free.pop(int(distance.argmin()))]
    return pixels


def _area(corners: Float) -> float:
    return float(np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])))
