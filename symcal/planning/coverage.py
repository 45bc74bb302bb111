"""Rules on a plan as a whole: poses that differ enough, and that cover the working area."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError, RefusedError
from symcal.planning.area import WorkingArea
from symcal.planning.constraints import Constraint

Array = NDArray[np.float64]
PlanFunction = Callable[[Array], Array]


def pose_distance(a: Array, b: Array, area: WorkingArea) -> Array:
    """Distance of poses in the units of the working area: the Euclidean norm of their difference as shares of its
    spans.

    Args:
        a, b: shapes (..., dof) that broadcast.
    """
    return np.asarray(np.linalg.norm(area.unit(a) - area.unit(b), axis=-1))


def nearest_distance(poses: Array, area: WorkingArea) -> Array:
    """Distance of every pose of plans, shape (..., N, dof), from the nearest other one, shape (..., N); inf for N =
    1."""
    distance = pose_distance(poses[..., :, None, :], poses[..., None, :, :], area)
    n = poses.shape[-2]
    distance[..., np.arange(n), np.arange(n)] = np.inf
    return np.asarray(distance.min(axis=-1))


def apart(area: WorkingArea, minimum: float) -> PlanFunction:
    """(P, N, dof) -> (P,): how much the poses of a plan lack of the minimum distance, summed and in shares of it."""

    def lacking(plans: Array) -> Array:
        near = nearest_distance(plans, area)
        return np.asarray(np.maximum(1.0 - near / minimum, 0.0).sum(axis=-1))

    return lacking


def away_from(poses: Array, area: WorkingArea, minimum: float) -> Constraint:
    """A pose keeps the minimum distance from given ones, shape (K, dof), such as those already in a plan."""

    def lacking(candidates: Array) -> Array:
        distance = pose_distance(candidates[:, None], poses[None], area)
        return np.asarray(minimum - distance.min(axis=1, initial=np.inf))

    return Constraint("apart from the other poses", "1", lacking, scale=minimum)


@dataclass(frozen=True, slots=True)
class Coverage:
    """Cells of a box in which a plan must have poses; made by `coverage`.

    coordinates: (N, dof) -> (N, k), where a pose counts: its tool position, or the joint readings themselves.
    lower, upper: of the box, shape (k,). divisions: cells along each axis, shape (k,). reachable: numbers of the cells
    that poses can be in.
    """

    coordinates: Callable[[Array], Array]
    lower: Array
    upper: Array
    divisions: NDArray[np.intp]
    reachable: NDArray[np.intp]

    def cell(self, poses: Array) -> NDArray[np.intp]:
        """Number of the cell of each pose, shape (N,); poses outside the box count in its outermost cells."""
        share = (self.coordinates(poses) - self.lower) / np.where(self.upper > self.lower, self.upper - self.lower, 1.0)
        index = np.clip((share * self.divisions).astype(np.intp), 0, self.divisions - 1)
        return np.asarray(np.ravel_multi_index(tuple(index.T), tuple(self.divisions)), dtype=np.intp)

    def missed(self, plans: Array) -> NDArray[np.intp]:
        """Reachable cells without a pose, shape (P,), of plans (P, N, dof)."""
        occupied = np.zeros((len(plans), int(np.prod(self.divisions))), dtype=np.bool_)
        cells = self.cell(plans.reshape(-1, plans.shape[-1])).reshape(plans.shape[:2])
        occupied[np.arange(len(plans))[:, None], cells] = True
        return np.asarray(len(self.reachable) - occupied[:, self.reachable].sum(axis=1), dtype=np.intp)

    def violation(self, share: float = 1.0) -> PlanFunction:
        """(P, N, dof) -> (P,): cells that a plan lacks of the wanted share of the reachable ones; 0 if it has them."""
        wanted = int(np.ceil(share * len(self.reachable) - 1e-9))

        def lacking(plans: Array) -> Array:
            return np.maximum(self.missed(plans) - (len(self.reachable) - wanted), 0).astype(np.float64)

        return lacking


def coverage(
    coordinates: Callable[[Array], Array], sample: Array, divisions: tuple[int, ...], *, poses: int | None = None
) -> Coverage:
    """Cells of the box around what a sample of feasible poses reaches; cells that no pose of it is in are left out.

    Args:
        coordinates: see `Coverage`. sample: feasible poses, shape (S, dof); a thousand per cell find even small
        corners.
        divisions: cells along each of the k coordinates. poses: size of the plan, if it is known.
    Raises:
        InputError: divisions that do not fit the coordinates. RefusedError: more cells than the plan has poses.
    """
    where = coordinates(sample)
    if where.shape[1] != len(divisions) or min(divisions, default=0) < 1:
        raise InputError(f"need {where.shape[1]} numbers of cells, each at least 1", key="cells", found=divisions)
    made = Coverage(
        coordinates, where.min(axis=0), where.max(axis=0), np.array(divisions, dtype=np.intp), np.zeros(0, np.intp)
    )
    reachable = np.unique(made.cell(sample))
    if poses is not None and len(reachable) > poses:
        raise RefusedError(f"{poses} poses cannot cover {len(reachable)} cells: ask for fewer cells or more poses")
    return Coverage(made.coordinates, made.lower, made.upper, made.divisions, reachable)
