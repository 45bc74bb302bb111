"""Move the poses of a plan to where the criterion is best: L-BFGS-B with exact derivatives, within the joint limits.

    d score / d q_i = sum_ab slope_ab d(F^T F)_ab / dq_i

Constraints that are only known as yes or no are kept by walking back towards where the pose came from.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.planning.area import Feasible
from symcal.planning.criteria import Criterion
from symcal.planning.information import PoseInformation

Array = NDArray[np.float64]

ITERATIONS = 200
_HALVINGS = 6


def refine(
    info: PoseInformation,
    criterion: Criterion,
    poses: Array,
    fixed: Array,
    *,
    feasible: Feasible | None = None,
    distance: float = 0.0,
    keep_off: Array | None = None,
    iterations: int = ITERATIONS,
    progress: Callable[[Array, float], None] | None = None,
) -> Array:
    """The plan after refinement: never worse than it was, feasible if it was feasible; shape (N, dof).

    Args:
        poses: a plan, shape (N, dof), rad or mm. fixed: information that is there anyway, shape (n, n).
        distance, keep_off: smallest distance between poses, and to these, in units of the working area.
        progress: told the poses and their score after each iteration that improves.
    """
    area = info.area
    moving = area.span > 0
    shape = poses.shape

    def score(at: Array) -> float:
        rows = info.rows(at).reshape(-1, info.rank)
        return float(criterion.score(fixed + rows.T @ rows))

    def loss(u: Array) -> tuple[float, Array]:
        at = area.lower + area.span * u.reshape(shape)
        rows = info.rows(at).reshape(-1, info.rank)
        total = fixed + rows.T @ rows
        value = float(criterion.score(total))
        if not np.isfinite(value):
            return 1e30, np.zeros(u.shape)
        _, gradient = info.function.weighted_gradient(at, criterion.slope(total))
        return -value, np.asarray(-(gradient * area.span * moving).ravel())

    def told(intermediate_result: object) -> None:
        if progress is not None:
            u = np.asarray(getattr(intermediate_result, "x"))  # noqa: B009 - scipy's result type is not public
            progress(area.lower + area.span * u.reshape(shape), -float(getattr(intermediate_result, "fun")))  # noqa: B009

    start = np.clip(area.unit(poses), 0.0, 1.0)
    before = score(poses)
    found = scipy.optimize.minimize(
        loss,
        start.ravel(),
        jac=True,
        method="L-BFGS-B",
        bounds=[(0.0, 1.0)] * start.size,
        callback=told,
        options={"maxiter": iterations, "maxcor": 20, "ftol": 1e-12, "gtol": 1e-8},
    )
    moved = area.clip(area.lower + area.span * np.asarray(found.x).reshape(shape))
    moved = np.where(moving, moved, poses)
    if feasible is not None:
        moved = walk_back(poses, moved, feasible)
    if distance > 0:
        moved = _apart(area.unit(poses), area.unit(moved), poses, moved, distance, keep_off)
    return moved if score(moved) > before else poses


def walk_back(start: Array, end: Array, feasible: Feasible) -> Array:
    """For each pose the point nearest to ``end``, of those tried on the straight line from ``start``, that is feasible.

    Args:
        start: feasible poses, shape (N, dof). end: where they want to go, shape (N, dof).
    """
    good, reach = np.zeros(len(start)), np.ones(len(start))
    inside = feasible(end)
    good[inside] = 1.0
    low, high = np.zeros(len(start)), reach
    for _ in range(_HALVINGS):
        open_ = np.flatnonzero(good < 1.0)
        if len(open_) == 0:
            break
        middle = 0.5 * (low[open_] + high[open_])
        at = start[open_] + middle[:, None] * (end[open_] - start[open_])
        fits = feasible(at)
        low[open_[fits]] = middle[fits]
        high[open_[~fits]] = middle[~fits]
    share = np.where(good == 1.0, 1.0, low)
    return np.asarray(np.where(share[:, None] == 1.0, end, start + share[:, None] * (end - start)))


def _apart(old_unit: Array, new_unit: Array, old: Array, new: Array, distance: float, keep_off: Array | None) -> Array:
    """Take back the moves that bring two poses too near, one after the other; the old plan kept its distances."""
    others = np.zeros((0, old.shape[1])) if keep_off is None else keep_off
    unit, result = new_unit.copy(), new.copy()
    for _ in range(len(old)):
        gaps = scipy.spatial.distance.cdist(unit, unit) + np.diag(np.full(len(unit), np.inf))
        close = (gaps < distance).sum(axis=1) + (scipy.spatial.distance.cdist(unit, others) < distance).sum(axis=1)
        close = np.where((result == old).all(axis=1), 0, close)
        if not close.any():
            break
        worst = int(np.argmax(close))
        unit[worst], result[worst] = old_unit[worst], old[worst]
    return result
