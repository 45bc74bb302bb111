"""The largest value of tr(F(q) W F(q)^T) over a set of poses: the worst pose of a plan.

Searched, not proven: by dense sampling (uniform, and with coordinates snapped to limits, all corners among them) and a
polish of the best samples, by L-BFGS-B with exact derivatives, and where constraints cut by a shrinking random climb. A
finite set is searched completely.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from symcal.planning.area import Feasible, WorkingArea, draw
from symcal.planning.rows import SubspaceRows

Array = NDArray[np.float64]

STARTS = 16
"""Samples that are polished."""

_CORNERS = 12  # joints up to which all 2^dof corners are looked at
_CLIMB_STEPS, _CLIMB_TRIES = 24, 24


@dataclass(frozen=True, slots=True)
class FeasibleSet:
    """The poses that can be measured, or in which something is asked: a dense sample, and where it came from.

    sample: shape (K, dof). area, feasible: the continuous set behind it; area is None if the sample is all there is.
    """

    sample: Array
    area: WorkingArea | None
    feasible: Feasible | None = None


def feasible_set(
    area: WorkingArea, rng: np.random.Generator, count: int, feasible: Feasible | None = None
) -> FeasibleSet:
    """A dense sample: half uniform, half with 40 % of the coordinates snapped to limits, and the corners."""
    parts = [draw(area, rng, count // 2, feasible), draw(area, rng, count - count // 2, feasible, share=0.4)]
    if area.dof <= _CORNERS:
        corners = np.array(list(itertools.product(*zip(area.lower, area.upper, strict=True))))
        parts.append(corners if feasible is None else corners[feasible(corners)])
    return FeasibleSet(np.concatenate(parts), area, feasible)


def largest(
    function: SubspaceRows, weight: Array, where: FeasibleSet, rng: np.random.Generator, *, starts: int = STARTS
) -> tuple[Array, Array]:
    """Local maxima of tr(F W F^T), best first: values (k,), poses (k, dof); the first is the maximum as far as known.

    Args:
        weight: W, shape (n, n), symmetric. starts: how many samples are polished; 0 for sampling alone.
    """
    values = function.weighted(where.sample, weight)
    values = np.where(np.isfinite(values), values, -np.inf)
    area = where.area
    if area is None or starts == 0:
        best = int(np.argmax(values))
        return values[best : best + 1], where.sample[best : best + 1]
    first = _spread(values, area.unit(where.sample), starts)
    poses = np.array([_polish(function, weight, area, pose) for pose in where.sample[first]])
    if where.feasible is not None:
        outside = ~where.feasible(poses)
        poses[outside] = _climb(function, weight, where, where.sample[first][outside], rng)
    reached = function.weighted(poses, weight)
    lost = ~(reached >= values[first])
    poses[lost], reached[lost] = where.sample[first][lost], values[first][lost]
    order = np.argsort(-reached, kind="stable")
    return reached[order], poses[order]


def _spread(values: Array, unit: Array, count: int, apart: float = 0.1) -> NDArray[np.intp]:
    """The best samples that are not neighbours of a better one."""
    order = np.argsort(-values, kind="stable")[: 40 * count]
    chosen: list[int] = []
    for i in order:
        if len(chosen) == count:
            break
        if not chosen or np.min(np.sum((unit[chosen] - unit[i]) ** 2, axis=1)) > apart**2:
            chosen.append(int(i))
    return np.array(chosen, dtype=np.intp)


def _polish(function: SubspaceRows, weight: Array, area: WorkingArea, pose: Array) -> Array:
    span = area.span

    def loss(u: Array) -> tuple[float, Array]:
        value, gradient = function.weighted_gradient((area.lower + span * u)[None], weight)
        if not np.isfinite(value[0]):
            return 1e30, np.zeros(u.shape)
        return -float(value[0]), -gradient[0] * span

    bounds = [(0.0, 1.0)] * area.dof
    found = minimize(loss, area.unit(pose), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 50})
    return area.clip(area.lower + span * np.asarray(found.x))


def _climb(function: SubspaceRows, weight: Array, where: FeasibleSet, poses: Array, rng: np.random.Generator) -> Array:
    """Random ascent among feasible neighbours, the steps shrinking from a tenth of the area to a ten-thousandth."""
    if where.area is None or where.feasible is None or len(poses) == 0:
        return poses
    poses = poses.copy()
    best = function.weighted(poses, weight)
    for radius in np.geomspace(0.1, 1e-4, _CLIMB_STEPS):
        step = rng.normal(size=(len(poses), _CLIMB_TRIES, poses.shape[1])) * radius * where.area.span
        trial = where.area.clip(poses[:, None, :] + step)
        flat = trial.reshape(-1, poses.shape[1])
        values = np.where(where.feasible(flat), function.weighted(flat, weight), -np.inf).reshape(len(poses), -1)
        top = np.argmax(values, axis=1)
        at = np.arange(len(poses))
        better = values[at, top] > best
        poses[better], best[better] = trial[at, top][better], values[at, top][better]
    return poses
