"""Image points as positions, one image at a time, as the paper measures them.

Each image of three points gives the pose of the target in the camera ([Ding2017] eq. 5), and so three positions in the
camera's frame, or their centroid. Positions along the line of sight are some 25 times less certain than those across,
and the nine numbers of a pose are strongly correlated: their covariance, of rank 6, goes along.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import Camera
from symcal.camera.p3p import P3PResult, points_covariance, solve_p3p_batch
from symcal.camera.target import Target
from symcal.data.dataset import Dataset, readings
from symcal.errors import RefusedError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class P3PData:
    """Positions in the camera frame, of the poses that gave a solution.

    points: of the target's points, with their covariance. centroid: of their mean. results: one per pose.
    notes: what was left out, and what is not sure.
    """

    points: Dataset
    centroid: Dataset
    results: tuple[P3PResult, ...]
    notes: tuple[str, ...]


def p3p_positions(data: Dataset, camera: Camera, target: Target, predicted: Array, sigma_px: float) -> P3PData:
    """Solve every image of a set by itself.

    Args:
        data: image points (`pixels`) of a target with three points.
        predicted: T_camera_target by the nominal robot, shape (N, 4, 4), mm: it chooses among the solutions.
        sigma_px: standard deviation of each image coordinate.
    Raises:
        RefusedError: a target of more than three points, or no image that can be solved.
    """
    if len(target.names) != 3:
        raise RefusedError(f"P3P takes three points, and the target has {len(target.names)}")
    whole = np.flatnonzero(np.isfinite(data.z).all(axis=1))
    if not whole.size:
        raise RefusedError("no image shows all three points")
    pixels = data.z[whole].reshape(-1, 3, 2)
    solved = solve_p3p_batch(camera, target.points, pixels, predicted[whole], sigma_px, normal=np.array(target.normal))
    kept, results = [], []
    unsolved, unsure = [data.labels[i] for i in range(len(data)) if i not in set(whole.tolist())], []
    for i, result in zip(whole.tolist(), solved, strict=True):
        if result is None or not np.isfinite(result.covariance).all():
            unsolved.append(data.labels[i])
            continue
        kept.append(i)
        results.append(result)
        if not result.sure:
            unsure.append(data.labels[i])
    if not kept:
        raise RefusedError("no image gives a pose of the three points")
    poses = np.array([result.T_camera_target for result in results])
    at = np.einsum("nij,kj->nki", poses[:, :3, :3], target.points) + poses[:, None, :3, 3]
    covariance = np.array([points_covariance(result, target.points) for result in results])
    base = replace(data.take(kept), sigma=None)
    notes = []
    if unsolved:
        notes.append(f"{_poses(unsolved)} no P3P solution and left out")
    if unsure:
        notes.append(f"{_poses(unsure)} a P3P solution whose choice is not sure")
    return P3PData(
        points=replace(base, of=readings("position", target.names), z=at.reshape(len(kept), 9), covariance=covariance),
        centroid=replace(base, z=at.mean(axis=1), of=readings("position", ("centroid",))),
        results=tuple(results),
        notes=tuple(notes),
    )


def _poses(labels: list[str]) -> str:
    listed = ", ".join(labels[:5]) + (", ..." if len(labels) > 5 else "")
    return f"{len(labels)} pose(s) ({listed}) have"
