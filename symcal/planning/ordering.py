"""In which order to drive to the poses of a plan: the shortest tour in joint time.

Going from a to b takes max_j |b_j - a_j| / speed_j: all joints start and arrive together and the slowest decides;
acceleration is left out. The tour starts at a given pose, visits all and stays at the last. It is a local optimum, not
a proven shortest tour; see `symcal.planning.tour_search`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.planning.tour_search import shortest_path
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Tour:
    """An order of poses and how long it takes.

    order: indices of the poses, shape (N,). times: from the pose before (first: from the start), shape (N,), s. total:
        their sum.
    """

    order: Index
    times: Array

    @property
    def total(self) -> float:
        return float(self.times.sum())


def joint_speeds(robot: Robot, given: Sequence[float] | None = None) -> Array:
    """Largest speed of every joint, shape (dof,), rad/s and mm/s: the given ones, else those of the robot file.

    Raises:
        InputError: neither says how fast a joint is (a guess would make every time in the plan one), or a speed is not
            positive.
    """
    if given is not None:
        speeds = np.asarray(given, dtype=np.float64)
        if speeds.shape != (robot.dof,) or not np.all(np.isfinite(speeds) & (speeds > 0)):
            message = f"need {robot.dof} positive speeds, one per joint (rad/s or mm/s)"
            raise InputError(message, key="speeds", found=list(given))
        return speeds
    missing = [joint.name for joint in robot.joints if joint.speed is None]
    if missing:
        names = ", ".join(missing)
        message = f"the robot file gives no speed for {names}: add 'speed' to its joints, or 'speeds' to the plan"
        raise InputError(message, key="speeds")
    return np.array([joint.speed for joint in robot.joints], dtype=np.float64)


def joint_time(a: Array, b: Array, speeds: Array) -> Array:
    """Time from a to b, s; joint readings of shapes (..., dof) that broadcast."""
    return np.asarray(np.max(np.abs(b - a) / speeds, axis=-1))


def shortest_tour(poses: Array, start: Array, speeds: Array, blocked: NDArray[np.bool_] | None = None) -> Tour:
    """Order the poses of a plan, shape (N, dof), for a tour from ``start``, shape (dof,).

    Poses that are equal follow each other.

    Args:
        blocked: ways that are to be avoided wherever a tour can, symmetric, shape (N + 1, N + 1), the start first.
    """
    if len(poses) == 0:
        return Tour(np.zeros(0, dtype=np.intp), np.zeros(0))
    nodes = np.vstack([start, poses])
    # a plan of many poses takes the best ones many times: of each only the first is ordered
    _, first, group = np.unique(nodes, axis=0, return_index=True, return_inverse=True)
    first, place = np.sort(first), np.argsort(np.argsort(first))
    group = place[group.ravel()]
    times = joint_time(nodes[first][:, None], nodes[first][None], speeds)
    if blocked is not None:
        times = times + blocked[np.ix_(first, first)] * times.sum(axis=1).max()
    path = shortest_path(times)
    order = np.argsort(np.argsort(path)[group], kind="stable")[1:] - 1
    return tour_of(order, poses, start, speeds)


def tour_of(order: Sequence[int] | Index, poses: Array, start: Array, speeds: Array) -> Tour:
    """A given order as a `Tour`."""
    index = np.asarray(order, dtype=np.intp)
    nodes = np.vstack([start, poses[index]])
    return Tour(index, joint_time(nodes[:-1], nodes[1:], speeds))
