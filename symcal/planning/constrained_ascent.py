"""Climb to local maxima of tr(F(q) W F(q)^T) within constraints, along their borders where the maxima lie.

Steps are as long as [Barzilai1988] has them, and projected onto the constraints as they are linearised at the pose
([Rosen1961]): min |d - l g|^2 with c + A d <= 0, by Hildreth's alternating multipliers ([Hildreth1957]). Where the
border is curved the end of a step is brought back the same way. Only feasible ends that are higher count.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from symcal.planning.area import WorkingArea
from symcal.planning.constraints import Satisfied
from symcal.planning.staged_rows import StagedRows
from symcal.planning.subspace_rows import SubspaceRows

Array = NDArray[np.float64]

_FIRST_STEP, _LONGEST = 0.01, 0.2  # of the working area
_STILL = 1e-6  # of the working area: a pose that has moved by less, or may, rests
_DIFFERENCE = 1e-6  # of the working area, for slopes of constraints
_SWEEPS = 12  # over the multipliers, at most
_SETTLED = 1e-10  # of the working area: a sweep that moves nothing by more is the last
_RETURNS = 2  # corrections of a step that ended outside
_INSIDE = 1e-7  # of a constraint's scale: where corrections aim


def climb_within(
    function: SubspaceRows | StagedRows, weight: Array, area: WorkingArea, within: Satisfied, poses: Array, steps: int
) -> tuple[Array, Array]:
    """Each pose for itself, all at once: poses (k, dof) and their values (k,).

    Args:
        weight: W, symmetric, shape (n, n). poses: feasible, shape (k, dof). steps: at most.
    """
    span, lower = area.span, area.lower

    def at(unit: Array) -> Array:
        return area.clip(lower + span * unit)

    unit = np.clip(area.unit(poses), 0.0, 1.0)
    value, slope = function.weighted_gradient(at(unit), weight)
    gradient = slope * span
    length = _FIRST_STEP / np.maximum(np.abs(gradient).max(axis=1), 1e-300)
    broken = within.violations(at(unit))
    awake = np.arange(len(poses))
    for _ in range(steps):
        if not len(awake):
            break
        here, up = unit[awake], gradient[awake]
        wish = length[awake, None] * up
        wish *= np.minimum(_LONGEST / np.maximum(np.abs(wish).max(axis=1), 1e-300), 1.0)[:, None]
        trial = np.clip(here + wish, 0.0, 1.0)
        there = within.violations(at(trial))
        out = np.flatnonzero((there > 0).any(axis=1))
        if len(out):
            c = broken[awake[out]]
            normals = _normals(within, at, here[out], c)
            trial[out] = here[out] + _nearest(wish[out], c, normals, here[out])
            there[out] = within.violations(at(trial[out]))
        for _ in range(_RETURNS):
            left = np.flatnonzero((there[out] > 0).any(axis=1))
            if not len(left):
                break
            back = out[left]
            trial[back] += _nearest(np.zeros_like(trial[back]), there[back] + _INSIDE, normals[left], trial[back])
            there[back] = within.violations(at(trial[back]))
        tried, slope = function.weighted_gradient(at(trial), weight)
        slope = slope * span
        better = (tried > value[awake]) & (there <= 0).all(axis=1)
        step = trial - here
        curvature = -np.sum(step * (slope - up), axis=1)
        fresh = np.sum(step**2, axis=1) / np.where(curvature > 0, curvature, np.inf)
        now = length[awake]
        length[awake] = np.where(better, np.where(curvature > 0, np.maximum(fresh, 0.1 * now), 4 * now), 0.25 * now)
        moved = awake[better]
        unit[moved], value[moved], gradient[moved] = trial[better], tried[better], slope[better]
        broken[moved] = there[better]
        awake = awake[np.abs(step).max(axis=1) > _STILL]
    return at(unit), value


def _normals(within: Satisfied, at: Callable[[Array], Array], unit: Array, broken: Array) -> Array:
    """Slopes of the violations by forward differences, away from the nearer limit, shape (k, K, dof)."""
    count, dof = unit.shape
    sign = np.where(unit > 0.5, -1.0, 1.0)
    shifted = unit[:, None, :] + _DIFFERENCE * sign[:, :, None] * np.eye(dof)
    there = within.violations(at(shifted.reshape(-1, dof))).reshape(count, dof, -1)
    change = (there - broken[:, None, :]) / (_DIFFERENCE * sign[:, :, None])
    return np.asarray(np.nan_to_num(change.swapaxes(1, 2), nan=0.0, posinf=0.0, neginf=0.0))


def _nearest(wish: Array, broken: Array, normals: Array, unit: Array) -> Array:
    """The step nearest to a wish that keeps the linearised constraints and the box, shape (k, dof).

    Args:
        broken, normals: c, shape (k, K), and A, shape (k, K, dof). unit: where the steps begin, in the unit box.
    """
    sizes = np.sum(normals**2, axis=2)
    safe = np.where(sizes > 0, sizes, 1.0)
    step = np.clip(unit + wish, 0.0, 1.0) - unit
    if not (broken + np.einsum("kcd,kd->kc", normals, step) > 0).any():
        return step
    free, multipliers, box = wish.copy(), np.zeros_like(broken), np.zeros_like(wish)
    for _ in range(_SWEEPS):
        before, shifted = step, 0.0
        for i in range(broken.shape[1]):
            normal = normals[:, i]
            excess = (broken[:, i] + np.sum(normal * free, axis=1)) / safe[:, i]
            more = np.where(sizes[:, i] > 0, np.maximum(multipliers[:, i] + excess, 0.0), 0.0)
            shift = (more - multipliers[:, i])[:, None] * normal
            free -= shift
            multipliers[:, i] = more
            shifted = max(shifted, float(np.abs(shift).max()))
        # the box is one more convex set, whose correction is kept ([Dykstra1983])
        moved = free + box
        step = np.clip(unit + moved, 0.0, 1.0) - unit
        box = moved - step
        free = step.copy()
        if shifted <= _SETTLED and np.abs(step - before).max() <= _SETTLED:
            break
    return step
