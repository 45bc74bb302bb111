"""The largest value of tr(F(q) W F(q)^T) over a set of poses: the worst pose of a plan.

Searched, not proven: by dense sampling (uniform, and with coordinates snapped to limits, all corners among them) and a
polish of the best samples, by L-BFGS-B with exact derivatives, and where constraints cut by a shrinking random climb. A
thorough search takes more and fresh samples and polishes hundreds of them. A finite set is searched completely.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.planning.area import Feasible, WorkingArea, draw
from symcal.planning.constrained_ascent import climb_within
from symcal.planning.constraints import Satisfied
from symcal.planning.staged_rows import StagedRows
from symcal.planning.subspace_rows import SubspaceRows

Array = NDArray[np.float64]
PoseRows = SubspaceRows | StagedRows
"""F(q) of a measurement, or of what is asked."""

STARTS = 16
"""Samples that are polished."""
THOROUGH_STARTS, THOROUGH_SAMPLE = 300, 20_000
"""The same for a thorough search, and how many fresh samples it draws."""

_TOGETHER = 80  # iterations in which all starts of a thorough search climb at once

_ASCENTS = 60  # steps of a quick climb
_FIRST_STEP = 0.01  # of the working area
_STILL = 1e-7
_SAME = 0.02  # of the working area: poses so near count as the same maximum
_CLIMBERS = 48  # of them that look about when constraints cut

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
    function: PoseRows, weight: Array, where: FeasibleSet, rng: np.random.Generator, *, thorough: bool = False
) -> tuple[Array, Array]:
    """Local maxima of tr(F W F^T), best first: values (k,), poses (k, dof); the first is the maximum as far as known.

    Args:
        weight: W, shape (n, n), symmetric. thorough: for a figure that somebody will rely on.
    """
    area = where.area
    if thorough and area is not None:
        fresh = feasible_set(area, rng, THOROUGH_SAMPLE, where.feasible).sample
        where = FeasibleSet(np.concatenate([where.sample, fresh]), area, where.feasible)
    values = function.weighted(where.sample, weight)
    values = np.where(np.isfinite(values), values, -np.inf)
    if area is None:
        best = int(np.argmax(values))
        return values[best : best + 1], where.sample[best : best + 1]
    first = _spread(values, area.unit(where.sample), THOROUGH_STARTS if thorough else STARTS)
    if isinstance(where.feasible, Satisfied):
        first = _anywhere(first, values, len(first), rng)
    begun = where.sample[first]
    if isinstance(where.feasible, Satisfied):
        poses, reached = climb_within(
            function, weight, area, where.feasible, begun, _TOGETHER if thorough else _ASCENTS
        )
        order = np.argsort(-reached, kind="stable")
        return reached[order], poses[order]
    if thorough:
        begun = _polish(function, weight, area, begun, _TOGETHER)
        order = np.argsort(-function.weighted(begun, weight), kind="stable")
        first, begun = first[order], begun[order]
    few = np.concatenate([_polish(function, weight, area, pose[None], 50) for pose in begun[:STARTS]])
    poses = np.concatenate([few, begun[STARTS:]])
    if where.feasible is not None:
        outside = ~where.feasible(poses)
        poses[outside] = _climb(function, weight, where, where.sample[first][outside], rng)
    reached = function.weighted(poses, weight)
    lost = ~(reached >= values[first])
    poses[lost], reached[lost] = where.sample[first][lost], values[first][lost]
    order = np.argsort(-reached, kind="stable")
    return reached[order], poses[order]


def maxima(
    function: PoseRows,
    weight: Array,
    where: FeasibleSet,
    rng: np.random.Generator,
    begun: Array,
    count: int,
    *,
    wide: bool = False,
) -> tuple[Array, Array]:
    """Poses where tr(F W F^T) is large, best first, near the given ones and near the best of the sample: values (k,)
    and poses (k, dof), each near to none that is better. Faster than `largest` and less exact.

    Args:
        begun: feasible poses to climb from, shape (j, dof). count: samples to climb from beside them.
        wide: where constraints cut, let all of them look about for better ones, and not only the best.
    """
    area = where.area
    values = function.weighted(where.sample, weight)
    values = np.where(np.isfinite(values), values, -np.inf)
    if area is None:
        order = np.argsort(-values, kind="stable")[:count]
        return values[order], where.sample[order]
    first = _spread(values, area.unit(where.sample), count)
    if isinstance(where.feasible, Satisfied):
        first = _anywhere(first, values, count, rng)
    poses, reached = _ascend(function, weight, where, np.concatenate([begun, where.sample[first]]))
    if where.feasible is not None and not isinstance(where.feasible, Satisfied):
        best = np.argsort(-reached, kind="stable")[: None if wide else _CLIMBERS]
        poses[best] = _climb(function, weight, where, poses[best], rng)
        reached = function.weighted(poses, weight)
    apart = _spread(reached, area.unit(poses), len(poses), _SAME)
    return reached[apart], poses[apart]


def _ascend(function: PoseRows, weight: Array, where: FeasibleSet, poses: Array) -> tuple[Array, Array]:
    """Projected gradient steps of each pose for itself, all at once, of the length of [Barzilai1988]; a step that is
    not feasible or does not climb is taken back and shortened. Poses (k, dof) and their values (k,)."""
    area = where.area
    assert area is not None
    if isinstance(where.feasible, Satisfied):
        return climb_within(function, weight, area, where.feasible, poses, _ASCENTS)
    span, lower = area.span, area.lower

    def at(unit: Array) -> Array:
        return area.clip(lower + span * unit)

    unit = np.clip(area.unit(poses), 0.0, 1.0)
    value, gradient = function.weighted_gradient(at(unit), weight)
    gradient = gradient * span
    length = _FIRST_STEP / np.maximum(np.abs(gradient).max(axis=1), 1e-300)
    for _ in range(_ASCENTS):
        trial = np.clip(unit + length[:, None] * gradient, 0.0, 1.0)
        step = trial - unit
        tried, slope = function.weighted_gradient(at(trial), weight)
        slope = slope * span
        better = tried > value
        if where.feasible is not None:
            better[better] = where.feasible(at(trial[better]))
        change = slope - gradient
        curvature = -np.sum(step * change, axis=1)
        fresh = np.sum(step**2, axis=1) / np.where(curvature > 0, curvature, np.inf)
        length = np.where(better, np.where(curvature > 0, fresh, 4 * length), 0.25 * length)
        unit = np.where(better[:, None], trial, unit)
        gradient, value = np.where(better[:, None], slope, gradient), np.where(better, tried, value)
        if not np.any(np.abs(step) > _STILL):
            break
    return at(unit), value


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


def _anywhere(best: NDArray[np.intp], values: Array, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """The best samples and as many of any value: maxima in corners of constraints stand among low ones."""
    others = rng.choice(np.flatnonzero(np.isfinite(values)), size=min(count, np.isfinite(values).sum()), replace=False)
    return np.unique(np.concatenate([best, others]))


def _polish(function: PoseRows, weight: Array, area: WorkingArea, poses: Array, iterations: int) -> Array:
    """Climb from each pose, all at once (the sum of their values is maximised), shape (k, dof)."""
    span, shape = area.span, poses.shape

    def loss(u: Array) -> tuple[float, Array]:
        value, gradient = function.weighted_gradient(area.lower + span * u.reshape(shape), weight)
        total = float(value.sum())
        if not np.isfinite(total):
            return 1e30, np.zeros(u.shape)
        return -total, np.asarray(-(gradient * span).ravel())

    start = np.clip(area.unit(poses).ravel(), 0.0, 1.0)
    bounds = [(0.0, 1.0)] * start.size
    found = scipy.optimize.minimize(
        loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": iterations}
    )
    return area.clip(area.lower + span * np.asarray(found.x).reshape(shape))


def _climb(function: PoseRows, weight: Array, where: FeasibleSet, poses: Array, rng: np.random.Generator) -> Array:
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
