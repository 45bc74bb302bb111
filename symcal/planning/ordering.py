"""In which order to drive to the poses of a plan: the shortest tour in joint time.

Going from a to b takes max_j |b_j - a_j| / speed_j: all joints start and arrive together and the slowest decides;
acceleration is left out. The tour starts at a given pose, visits all and stays at the last. Nearest neighbour from
every possible first pose, then 2-opt and Or-opt moves until none helps ([Croes1958], [Or1976]): a local optimum, not a
proven shortest tour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_LONGEST_MOVED = 3  # poses that an Or-opt move takes along
_STARTS = 12  # first poses tried; more gains next to nothing


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

    Args:
        blocked: ways that are to be avoided wherever a tour can, symmetric, shape (N + 1, N + 1), the start first.
    """
    nodes = np.vstack([start, poses])
    times = joint_time(nodes[:, None], nodes[None], speeds)
    cost = times if blocked is None else times + blocked * times.sum(axis=1).max()
    n = len(poses)
    if n == 0:
        return Tour(np.zeros(0, dtype=np.intp), np.zeros(0))
    firsts = 1 + np.argsort(cost[0, 1:], kind="stable")[: min(n, _STARTS)]
    best = min((_improved(_nearest(cost, int(first)), cost) for first in firsts), key=lambda path: _length(path, cost))
    return Tour(best[1:] - 1, times[best[:-1], best[1:]])


def tour_of(order: Sequence[int] | Index, poses: Array, start: Array, speeds: Array) -> Tour:
    """A given order as a `Tour`."""
    index = np.asarray(order, dtype=np.intp)
    nodes = np.vstack([start, poses[index]])
    return Tour(index, joint_time(nodes[:-1], nodes[1:], speeds))


def _length(path: Index, cost: Array) -> float:
    return float(cost[path[:-1], path[1:]].sum())


def _nearest(cost: Array, first: int) -> Index:
    """From node 0 by way of ``first`` always to the nearest node that is left."""
    path = [0, first]
    left = np.ones(len(cost), dtype=np.bool_)
    left[path] = False
    while left.any():
        path.append(int(np.argmin(np.where(left, cost[path[-1]], np.inf))))
        left[path[-1]] = False
    return np.array(path, dtype=np.intp)


def _improved(path: Index, cost: Array) -> Index:
    """A path from its first node that no 2-opt or Or-opt move makes shorter."""
    while True:
        for move in (_two_opt, _or_opt):
            better = move(path, cost)
            if better is not None:
                path = better
                break
        else:
            return path


def _padded(cost: Array) -> Array:
    """The costs with a node n that is everywhere for nothing: behind the open end of a path."""
    return np.pad(cost, ((0, 1), (0, 1)))


def _two_opt(path: Index, cost: Array) -> Index | None:
    """Reverse the part of the path that saves most; None if none saves."""
    c = _padded(cost)
    p = np.append(path, len(cost))
    n = len(path)
    i, j = np.triu_indices(n, 1)
    keep = i >= 1
    i, j = i[keep], j[keep]  # reverses p[i..j]; the start stays
    if not i.size:
        return None
    change = c[p[i - 1], p[j]] + c[p[i], p[j + 1]] - c[p[i - 1], p[i]] - c[p[j], p[j + 1]]
    k = int(np.argmin(change))
    if change[k] >= -1e-12 * (1.0 + cost.max()):
        return None
    return np.concatenate([path[: i[k]], path[i[k] : j[k] + 1][::-1], path[j[k] + 1 :]])


def _or_opt(path: Index, cost: Array) -> Index | None:
    """Move up to three neighbouring nodes elsewhere, either way round, where it saves most; None if nowhere."""
    c = _padded(cost)
    best_change, best_path = -1e-12 * (1.0 + cost.max()), None
    n = len(path)
    for length in range(1, min(_LONGEST_MOVED, n - 2) + 1):
        for i in range(1, n - length + 1):
            rest = np.append(np.delete(path, slice(i, i + length)), len(cost))
            head, tail = path[i], path[i + length - 1]
            after = path[i + length] if i + length < n else len(cost)
            freed = c[path[i - 1], head] + c[tail, after] - c[path[i - 1], after]
            before, behind = rest[:-1], rest[1:]
            gap = c[before, behind]
            for first, last, turn in ((head, tail, 1), (tail, head, -1)):
                change = c[before, first] + c[last, behind] - gap - freed
                k = int(np.argmin(change))
                if change[k] < best_change:
                    moved = path[i : i + length][::turn]
                    best_change = float(change[k])
                    best_path = np.concatenate([rest[: k + 1], moved, rest[k + 1 : -1]])
    return best_path
