"""The joint-space box in which poses are planned and predicted errors are taken, and how it is sampled."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError, RefusedError
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Feasible = Callable[[Array], Mask]
"""(N, dof) -> (N,): which poses can be measured; what the joint box alone does not say (visibility, keep-outs)."""

_TRIES = 400  # drawn poses per wanted one before a feasible set counts as empty
_SMALLEST_TRY = 4096


@dataclass(frozen=True, slots=True)
class WorkingArea:
    """A box of joint readings.

    lower, upper: shape (dof,), rad or mm, finite; lower < upper, or equal for a joint that is held.
    """

    lower: Array
    upper: Array

    @property
    def dof(self) -> int:
        return len(self.lower)

    @property
    def span(self) -> Array:
        return self.upper - self.lower

    def sample(self, rng: np.random.Generator, count: int) -> Array:
        """Poses uniform in joint space, shape (count, dof)."""
        return self.lower + self.span * rng.random((count, self.dof))

    def snapped(self, rng: np.random.Generator, count: int, share: float = 0.4) -> Array:
        """Uniform poses of which a share of all coordinates sits at a joint's lower or upper limit, shape (count, dof).

        Ours: informative poses have several joints at their limits, where a uniform sample almost never is.
        """
        poses = self.sample(rng, count)
        snap = rng.random(poses.shape) < share
        limit = np.where(rng.random(poses.shape) < 0.5, self.lower, self.upper)
        return np.where(snap, limit, poses)

    def even(self, count: int) -> Array:
        """Deterministic, evenly spread poses (the sequence of [Halton1960]), shape (count, dof)."""
        return self.lower + self.span * halton(count, self.dof)

    def clip(self, poses: Array) -> Array:
        return np.clip(poses, self.lower, self.upper)

    def contains(self, poses: Array) -> Mask:
        """Which poses lie in the box, up to rounding, shape (N,)."""
        slack = 1e-9 * (1.0 + np.maximum(np.abs(self.lower), np.abs(self.upper)))
        return np.asarray(np.all((poses >= self.lower - slack) & (poses <= self.upper + slack), axis=-1))

    def unit(self, poses: Array) -> Array:
        """Poses in units of the box: 0 at the lower and 1 at the upper limits; held joints are 0; shape (N, dof)."""
        return (poses - self.lower) / np.where(self.span > 0, self.span, 1.0)


def halton(count: int, dimensions: int) -> Array:
    """The first points of Halton's sequence in the unit cube, shape (count, dimensions).

    `scipy.stats.qmc` has it too, and takes two seconds to be imported.
    """
    out = np.zeros((count, dimensions))
    bases: list[int] = []
    candidate = 2
    while len(bases) < dimensions:
        if all(candidate % base for base in bases):
            bases.append(candidate)
        candidate += 1
    for column, base in zip(out.T, bases, strict=True):
        left, share = np.arange(count), 1.0
        while left.any():
            share /= base
            column += share * (left % base)
            left //= base
    return out


def working_area(
    robot: Robot, ranges: Mapping[str, tuple[float, float]] | None = None, *, margin: float = 0.0
) -> WorkingArea:
    """The joint limits, narrowed per joint.

    Args:
        ranges: (lower, upper) of a reading in rad or mm, by joint name or `q1`..`qn`.
        margin: kept away from each limit of the robot, as a share of the joint's travel.

    A revolute joint without limits counts as one full turn about zero.

    Raises:
        InputError: unknown joint, a range outside the limits, or a prismatic joint without limits or range.
    """
    ranges = ranges or {}
    names = {joint.name: i for i, joint in enumerate(robot.joints)} | {f"q{i + 1}": i for i in range(robot.dof)}
    given: dict[int, tuple[float, float]] = {}
    for name, pair in ranges.items():
        if name not in names:
            raise InputError("no such joint", key=name, found=name, allowed=names)
        given[names[name]] = pair
    bounds = [_range(robot, i, given.get(i), margin) for i in range(robot.dof)]
    return WorkingArea(np.array([low for low, _ in bounds]), np.array([high for _, high in bounds]))


def _range(robot: Robot, i: int, given: tuple[float, float] | None, margin: float) -> tuple[float, float]:
    joint = robot.joints[i]
    low, high = joint.lower, joint.upper
    if math.isfinite(low) and math.isfinite(high):
        low, high = low + margin * (high - low), high - margin * (high - low)
    if given is None:
        if math.isfinite(low) and math.isfinite(high):
            return low, high
        if joint.revolute:
            return max(low, -math.pi), min(high, math.pi)
        raise InputError("this prismatic joint has no limits: give its working range", key=joint.name)
    slack = 1e-9 * (1.0 + abs(given[0]) + abs(given[1]))
    if not (given[0] <= given[1] and given[0] >= low - slack and given[1] <= high + slack):
        message = f"a range must be [lower, upper] within [{low:.6g}, {high:.6g}] (rad or mm)"
        raise InputError(message, key=joint.name, found=list(given))
    return max(given[0], low), min(given[1], high)


def draw(
    area: WorkingArea, rng: np.random.Generator, count: int, feasible: Feasible | None = None, *, share: float = 0.0
) -> Array:
    """Feasible poses of the working area, shape (count, dof), by rejection.

    Args:
        share: of the coordinates that are snapped to joint limits; 0 for poses uniform in joint space.
    Raises:
        RefusedError: hardly any pose of the working area is feasible.
    """
    kept: list[Array] = []
    found = tried = 0
    while found < count:
        if tried >= max(_TRIES * count, 8 * _SMALLEST_TRY):
            message = f"only {found} of {tried} poses drawn in the working area are feasible, and {count} are needed"
            raise RefusedError(f"{message}: loosen the constraints or move the instrument")
        batch = max(count - found, _SMALLEST_TRY) if feasible else count
        poses = area.snapped(rng, batch, share) if share else area.sample(rng, batch)
        if feasible is not None:
            poses = poses[feasible(poses)]
        kept.append(poses)
        found += len(poses)
        tried += batch
    return np.concatenate(kept)[:count]
