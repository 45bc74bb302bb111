"""Constraints of a camera on the poses at which it can measure a target: field of view, depth, incidence."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import project_points
from symcal.model.assembled import margins_kernel
from symcal.model.facing import limits_of
from symcal.model.model import Model
from symcal.planning.camera_view import CameraView
from symcal.planning.constraints import Constraint

Array = NDArray[np.float64]

_FAR = 1e9  # outside, of a point that cannot be projected
_PART = 1024  # poses at once


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


@dataclass(frozen=True, slots=True)
class View:
    """What plans ask of cameras beyond what they can read: rad, mm and px.

    margin: from the image's border, px. depth: range along the optical axis, mm. incidence: largest angle between a
    target's normal and the ray to the camera, rad; that of the target when None. whole: every point of a target must be
    seen, of those too that count in part.
    """

    margin: float = 0.0
    depth: tuple[float, float] = (-math.inf, math.inf)
    incidence: float | None = None
    whole: bool = False


def within_limits(model: Model, view: View | None = None) -> tuple[Constraint, ...]:
    """What it takes for every instrument to read all that it is to read at a pose, at nominal.

    Of a board that counts in part: to read at least as many of its points as it needs, unless all are asked for.
    """
    made = []
    for part in model.measurement.parts:
        kernel, o = margins_kernel(part), part.observation
        if kernel is None or part.contact is not None:  # what touches keeps its own limits where it does
            continue
        asked = view if o.instrument.is_camera else None
        limits, at = limits_of(o), (model.setup.vector, np.zeros(len(model.parameters)))
        margins = _Margins(kernel, *at, tuple(limit.unit for limit in limits), o.target.largest_incidence, asked)
        count = len(o.features)
        if part.staged is not None and o.target.needed < count:
            scales = tuple(limit.scale for limit in limits)
            needed = count if asked is not None and asked.whole else o.target.needed
            some = f"at least {needed} of the {count} points" if needed < count else f"all {count} points"
            name = f"{some} of {o.target.name} seen by '{o.name}'"
            made.append(Constraint(name, "1", _Share(margins, scales, needed)))
            continue
        for i, limit in enumerate(limits):
            name = f"{o.target.name} {limit.name} '{o.name}'"
            made.append(Constraint(name, limit.unit, _Limit(margins, i), limit.scale))
    return tuple(made)


@dataclass(frozen=True, slots=True)
class _Margins:
    """By how much each feature can be read, less what a plan asks for, shape (N, K, limits)."""

    kernel: Callable[[Array, Array, Array], Array]
    setup: Array
    x: Array
    units: tuple[str, ...]
    incidence: float
    view: View | None

    def __call__(self, poses: Array) -> Array:
        margins = self.kernel(poses, self.x, self.setup)
        margins[np.isnan(margins)] = -_FAR
        if self.view is None:
            return margins
        near, far = self.view.depth
        for i, unit in enumerate(self.units):
            own = margins[:, :, i]
            if unit == "mm":
                margins[:, :, i] = np.minimum(own - max(near, 0.0), far - own)
            elif unit == "px":
                margins[:, :, i] = own - self.view.margin
            elif self.view.incidence is not None:
                margins[:, :, i] = own + (self.view.incidence - self.incidence)
        return margins


@dataclass(frozen=True, slots=True)
class _Limit:
    """By how much the worst feature is beyond limit i."""

    margins: _Margins
    i: int

    def __call__(self, poses: Array) -> Array:
        return _in_parts(lambda part: -self.margins(part)[:, :, self.i].min(axis=1), poses)


@dataclass(frozen=True, slots=True)
class _Share:
    """By how much the feature that is the last needed is beyond its limits, in units of their scales."""

    margins: _Margins
    scales: tuple[float, ...]
    needed: int

    def __call__(self, poses: Array) -> Array:
        def last(part: Array) -> Array:
            margins = self.margins(part)
            worst = margins[:, :, 0] / self.scales[0]
            for i, scale in enumerate(self.scales[1:], start=1):  # a minimum over so short an axis is slow in NumPy
                np.minimum(worst, margins[:, :, i] / scale, out=worst)
            if self.needed == worst.shape[1]:
                return np.asarray(-worst.min(axis=1))
            return np.asarray(-np.partition(worst, -self.needed, axis=1)[:, -self.needed])

        return _in_parts(last, poses)


def _in_parts(violation: Callable[[Array], Array], poses: Array) -> Array:
    """A violation of many poses, a few at a time: what is read at all of them would fill the memory."""
    parts = np.array_split(poses, max(-(-len(poses) // _PART), 1))
    return np.concatenate([violation(part) for part in parts])


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
