"""The poses of a check, and what it will find."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.planning.area import WorkingArea
from symcal.planning.ordering import shortest_tour
from symcal.watch.choose import choose
from symcal.watch.reference import Linear, Reference, linear_at
from symcal.watch.sensitivity import Sensitivity, fewest, plan_rows, poses_needed, sensitivity, undisturbed

Array = NDArray[np.float64]

POOL = 1000
"""Feasible poses that a check's are chosen from."""

_SOME = 40  # of them, by which it is told what can be found at all
_ANY = 1000.0  # times as many: as good as any number


@dataclass(frozen=True, slots=True, eq=False)
class CheckPlan:
    """Poses of a check, shape (N, dof), in the order of a short tour; made by `plan_check`.

    still, moved: what they find with the instrument where it was, and set up anew. needed: by joint, how many poses
    like these find the wanted offset; None where no number does. fewest: below that nothing is judged.
    """

    poses: Array
    still: Sensitivity
    moved: Sensitivity
    needed: Mapping[str, int | None]
    fewest: int


def plan_check(
    reference: Reference,
    pool: Array,
    area: WorkingArea,
    count: int,
    *,
    offsets: Mapping[str, float],
    alpha: float,
    moved: bool,
) -> CheckPlan:
    """Choose the poses of a check so that a wanted offset is found in as many joints as can be.

    Args:
        pool: poses that can be measured, shape (K, dof). area: what they are from. offsets: wanted, by joint, rad and
            mm. moved: for an instrument that is set up anew for every check.
    Raises:
        RefusedError: too few poses, or no joint can be seen.
    """
    least = fewest(reference, moved=moved)
    if count < least:
        raise RefusedError(f"{count} poses are too few to judge by: {least} are needed at least")
    some = pool[:: max(len(pool) // _SOME, 1)]
    whole = _linear(reference, some)
    found = sensitivity(reference, whole, alpha, offsets, moved=moved, poses=count / len(some))
    seen = [h for h in found.seen if h.joint is not None]
    if not seen:
        raise RefusedError("these measurements tell of no joint: an offset of plausible size would not be found")
    limit = sensitivity(reference, whole, alpha, offsets, moved=moved, poses=_ANY)
    joints = tuple([h for h in seen if limit.offset(h) <= offsets[h.name]] or seen)
    rows = plan_rows(reference, pool, moved=moved, joints=joints)
    chosen = pool[choose(pool, area.unit(pool), rows, count, len(joints))]
    chosen = chosen[_tour(reference, chosen, area)]
    linear = _linear(reference, chosen)
    needed = poses_needed(reference, linear, offsets, alpha, moved=moved)
    return CheckPlan(
        chosen,
        sensitivity(reference, linear, alpha, offsets, moved=False),
        sensitivity(reference, linear, alpha, offsets, moved=True),
        {name: None if n is None else max(n, least) for name, n in needed.items()},
        least,
    )


def _linear(reference: Reference, q: Array) -> Linear:
    return linear_at(reference, undisturbed(reference, q), np.zeros(len(reference.changed.parameters)))


def _tour(reference: Reference, poses: Array, area: WorkingArea) -> NDArray[np.intp]:
    speeds = np.array([joint.speed or np.nan for joint in reference.robot.joints])
    if np.isnan(speeds).any():
        speeds = np.where(area.span > 0, area.span, 1.0)
    return shortest_tour(poses, (area.lower + area.upper) / 2, speeds).order
