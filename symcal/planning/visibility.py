"""Constraints of a camera on the poses at which it can measure a target: field of view, depth, incidence."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import project_points
from symcal.kernels import BatchFunction, batch_function
from symcal.model.model import Model
from symcal.planning.camera_view import CameraView
from symcal.planning.constraints import Constraint

Array = NDArray[np.float64]


def visibility(
    view: CameraView,
    *,
    margin: float = 0.0,
    depth: tuple[float, float] = (0.0, math.inf),
    incidence: float = math.pi / 3,
) -> tuple[Constraint, ...]:
    """What it takes for the camera to measure all discs of the target at a pose.

    Args:
        margin: least distance of every whole disc's image from the image border, px.
        depth: least and largest distance of the discs from the camera along its axis, mm.
        incidence: largest angle between the target's normal and the ray to the camera, rad; below 90 degrees only the
            front of the target is seen.
    """
    return (
        Constraint("target in the camera's field of view", "px", _FieldOfView(view, margin), scale=100.0),
        Constraint("target in the range of depth", "mm", _Depth(view, *depth), scale=100.0),
        Constraint("target turned towards the camera", "rad", _Incidence(view, incidence), scale=0.1),
    )


def within_limits(model: Model) -> tuple[Constraint, ...]:
    """What it takes for every instrument to read all that it is to read at a pose, at nominal."""
    made = []
    for part in model.measurement.parts:
        if part.margins is None:
            continue
        kernel, o = batch_function(part.margins), part.observation
        for i, limit in enumerate(o.instrument.limits):
            violation = _Limit(kernel, model.setup.vector, np.zeros(len(model.parameters)), len(o.instrument.limits), i)
            made.append(Constraint(f"{o.target.name} {limit.name} '{o.name}'", limit.unit, violation, limit.scale))
    return tuple(made)


@dataclass(frozen=True, slots=True)
class _Limit:
    """By how much the worst feature is beyond limit i of so many."""

    kernel: BatchFunction
    setup: Array
    x: Array
    limits: int
    i: int

    def __call__(self, poses: Array) -> Array:
        (margins,) = self.kernel(poses, self.x, self.setup)
        return np.asarray(-margins.reshape(len(poses), -1, self.limits)[:, :, self.i].min(axis=1))


@dataclass(frozen=True, slots=True)
class _FieldOfView:
    """Pixels by which the worst disc leaves the image less its margin.

    At most width + height: so much where a disc cannot be projected at all (behind the camera, or so far outside that
    the lens model folds back), and then up to twice that the further it is from the axis, so that a search finds its
    way.
    """

    view: CameraView
    margin: float

    def __call__(self, poses: Array) -> Array:
        camera = self.view.camera
        points = self.view.points(poses)
        pixels = project_points(camera, points)
        low = -0.5 + self.margin
        size = np.array([camera.width, camera.height])
        # a disc's image is about an ellipse of this half axis; its centre must stay that much further inside
        radius = max(camera.fx, camera.fy) * self.view.target.disc_radius / np.maximum(points[..., 2], 1e-9)
        outside = np.maximum(low - pixels, pixels - (size - 0.5 - self.margin)).max(axis=-1) + radius
        ceiling = float(size.sum())
        angle = np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2])
        lost = ceiling * (1.0 + angle / math.pi)
        return np.asarray(np.where(np.isnan(outside), lost, np.minimum(outside, ceiling)).max(axis=-1))


@dataclass(frozen=True, slots=True)
class _Depth:
    """Millimetres by which the worst disc is nearer or farther than allowed."""

    view: CameraView
    near: float
    far: float

    def __call__(self, poses: Array) -> Array:
        z = self.view.points(poses)[..., 2]
        return np.asarray(np.maximum(self.near - z, z - self.far).max(axis=-1))


@dataclass(frozen=True, slots=True)
class _Incidence:
    """Radians by which the worst disc is seen too obliquely."""

    view: CameraView
    largest: float

    def __call__(self, poses: Array) -> Array:
        cosine = self.view.observe(poses)[1]
        return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)).max(axis=-1) - self.largest)
