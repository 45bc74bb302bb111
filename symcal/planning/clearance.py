"""Constraints that keep the arm's skeleton away from its surroundings: keep-out boxes and planes such as a table.

The body is the polyline of `symcal.planning.skeleton`; give its thickness as the margin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.planning.constraints import Constraint
from symcal.planning.skeleton import Skeleton

Array = NDArray[np.float64]


def box_distance(points: Array, lower: Array, upper: Array) -> Array:
    """Signed distance, mm, of points (..., 3) from an axis-aligned box: negative inside."""
    outside = np.maximum(lower - points, points - upper)
    far = np.linalg.norm(np.maximum(outside, 0.0), axis=-1)
    return np.asarray(far + np.minimum(outside.max(axis=-1), 0.0))


def keep_out(
    arm: Skeleton,
    name: str,
    T_world_box: Array,
    size: Array,
    *,
    margin: float = 0.0,
    first_link: int = 1,
    spacing: float = 20.0,
) -> Constraint:
    """No point of the links enters a box.

    Segments are sampled; half the distance between samples is added to the violation, so that nothing slips between
    them: the constraint is too strict by at most ``spacing`` / 2.

    Args:
        T_world_box: pose of the box's centre, (4, 4), mm. size: its edges, shape (3,), mm. margin: to be kept, mm.
        first_link: links below it are not looked at (the column that the box stands beside).
        spacing: of the samples, mm.
    Raises:
        InputError: a box without volume, or no such link.
    """
    half = np.asarray(size, dtype=np.float64) / 2
    if half.shape != (3,) or not np.all(half > 0):
        raise InputError("a keep-out box needs three positive edges", key="size", found=np.asarray(size).tolist())
    if not spacing > 0:
        raise InputError("must be positive", key="spacing", found=spacing)
    inside = _Box(arm, _segments(arm, first_link), np.asarray(T_world_box, dtype=np.float64), half, margin, spacing)
    return Constraint(f"clear of {name}", "mm", inside, scale=10.0)


def plane(
    arm: Skeleton, name: str, point: Array, normal: Array, *, margin: float = 0.0, first_link: int = 1
) -> Constraint:
    """All links stay on the side of a plane that its normal points to: above a table, in front of a wall.

    Args:
        point: on the plane, shape (3,), mm, world. normal: shape (3,), any length. margin: to be kept, mm.
        first_link: links below it are not looked at.
    Raises:
        InputError: the normal is zero, or there is no such link.
    """
    direction = np.asarray(normal, dtype=np.float64)
    length = float(np.linalg.norm(direction))
    if not length > 0:
        raise InputError("the normal of a plane must not be zero", key="normal", found=direction.tolist())
    below = _Plane(arm, _segments(arm, first_link), np.asarray(point, dtype=np.float64), direction / length, margin)
    return Constraint(f"clear of {name}", "mm", below, scale=10.0)


def _segments(arm: Skeleton, first_link: int) -> int:
    """Index of the first segment that belongs to ``first_link``."""
    if first_link not in arm.links:
        raise InputError("no such link", key="first_link", found=first_link, allowed=map(str, sorted(set(arm.links))))
    return arm.links.index(first_link)


@dataclass(frozen=True, slots=True)
class _Box:
    arm: Skeleton
    first: int
    T_world_box: Array
    half: Array
    margin: float
    spacing: float

    def __call__(self, poses: Array) -> Array:
        nodes = self.arm.nodes(poses)[:, self.first :]
        local = (nodes - self.T_world_box[:3, 3]) @ self.T_world_box[:3, :3]
        worst = np.full(len(poses), -np.inf)
        for start, end in zip(local[:, :-1].swapaxes(0, 1), local[:, 1:].swapaxes(0, 1), strict=True):
            length = np.linalg.norm(end - start, axis=-1)
            # no point of a segment is further from its middle than half its length: most are clear by that alone
            violation = self.margin + 0.5 * length - box_distance(0.5 * (start + end), -self.half, self.half)
            near = violation > 0
            if near.any():
                violation[near] = self._sampled(start[near], end[near], length[near])
            worst = np.maximum(worst, violation)
        return worst

    def _sampled(self, start: Array, end: Array, length: Array) -> Array:
        pieces = max(1, int(np.ceil(length.max() / self.spacing)))
        share = np.linspace(0.0, 1.0, pieces + 1)[:, None]
        points = start[:, None] + share * (end - start)[:, None]
        distance = box_distance(points, -self.half, self.half).min(axis=-1)
        return np.asarray(self.margin + 0.5 * length / pieces - distance)


@dataclass(frozen=True, slots=True)
class _Plane:
    arm: Skeleton
    first: int
    point: Array
    normal: Array
    margin: float

    def __call__(self, poses: Array) -> Array:
        # a segment's lowest point is one of its ends
        height = (self.arm.nodes(poses)[:, self.first :] - self.point) @ self.normal
        return np.asarray(self.margin - height.min(axis=-1))
