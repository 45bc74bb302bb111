"""What stands around an arm that a plan moves: keep-out boxes, planes, the camera's field of view; in world, mm."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.config.conversion import ExperimentFile
from symcal.planning.camera_view import CameraView
from symcal.robot.schema import Frame

Array = NDArray[np.float64]

SIGNS = np.array(list(itertools.product((-1, 1), repeat=3)))
"""Corners of a box in the order in which `Box` has them."""
EDGES = tuple((i, j) for i, j in itertools.combinations(range(8), 2) if np.sum(SIGNS[i] != SIGNS[j]) == 1)
"""Pairs of corners of a box that an edge joins."""

_NEAR = 0.35  # of the way from the camera to the nearest target: how far its field of view is drawn


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A box that no link may enter; corners: shape (8, 3)."""

    name: str
    corners: Array


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane that links stay on one side of; normal: of length one."""

    name: str
    point: Array
    normal: Array

    def patch(self, low: Array, high: Array) -> Array | None:
        """Corners of the piece of it that is beside a scene, shape (4, 3); None where it does not cut the scene.

        Args:
            low, high: corners of the scene, shape (3,).
        """
        corners = np.where(SIGNS < 0, low, high)
        height = (corners - self.point) @ self.normal
        if height.min() > 0 or height.max() < 0:
            return None
        across = np.linalg.svd(self.normal[None])[2][1:]
        flat = (corners - self.point) @ across.T
        (a, b), (c, d) = flat.min(axis=0), flat.max(axis=0)
        return np.asarray(self.point + np.array([[a, b], [c, b], [c, d], [a, d]]) @ across)


def boxes(file: ExperimentFile) -> tuple[Box, ...]:
    """The keep-out boxes of an experiment."""
    units, found = file.units, []
    for box in file.plan.constraints.keep_out:
        frame = Frame(xyz=box.xyz, rpy=box.rpy).matrix(units.factor("mm"), units.factor("rad"))
        half = np.array(box.size) * units.factor("mm") / 2
        found.append(Box(box.name, (SIGNS * half) @ frame[:3, :3].T + frame[:3, 3]))
    return tuple(found)


def planes(file: ExperimentFile) -> tuple[Plane, ...]:
    """The tables and walls of an experiment."""
    return tuple(
        Plane(
            wall.name,
            np.array(wall.point) * file.units.factor("mm"),
            np.array(wall.normal) / np.linalg.norm(wall.normal),
        )
        for wall in file.plan.constraints.planes
    )


def field_of_view(view: CameraView, seen: Array) -> Array:
    """The corners of what a camera sees, some way to the nearest of the points that it sees, and the camera, shape
    (5, 3).

    Args:
        seen: shape (k, 3), world.
    """
    camera, T = view.camera, view.T_world_camera
    depth = _NEAR * float(((seen - T[:3, 3]) @ T[:3, 2]).min())
    u, v = np.array([0, camera.width, camera.width, 0]) - 0.5, np.array([0, 0, camera.height, camera.height]) - 0.5
    beams = np.column_stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(4)])
    return np.vstack([depth * beams @ T[:3, :3].T + T[:3, 3], T[:3, 3]])
