"""Random feasible poses, by rejection."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.planning.area import WorkingArea
from symcal.planning.constraints import ROUNDING, Constraint, feasible

Array = NDArray[np.float64]

_DRAWS = 4096  # poses per round: enough to keep the kernels busy, little enough for the caches
_HITS = 5  # feasible poses that must be found for the share to count as known


def feasible_poses(
    rng: np.random.Generator,
    area: WorkingArea,
    constraints: Sequence[Constraint],
    count: int,
    *,
    snap: float = 0.0,
    least_share: float = 1e-4,
) -> Array:
    """``count`` independent poses that satisfy all constraints, uniform over the feasible part of the area.

    Args:
        snap: share of coordinates put at the area's limits (`WorkingArea.snapped`); 0 for uniform poses.
        least_share: give up when the feasible share of the area is smaller than this.
    Returns:
        shape (count, dof), rad and mm.
    Raises:
        RefusedError: too little of the area is feasible; says how much each constraint takes away.
    """
    allowed = feasible(constraints)
    found: list[Array] = []
    kept = drawn = 0
    while kept < count:
        poses = area.snapped(rng, _DRAWS, snap) if snap > 0 else area.sample(rng, _DRAWS)
        good = poses[allowed(poses)]
        found.append(good)
        kept, drawn = kept + len(good), drawn + _DRAWS
        if drawn * least_share > _HITS and kept < drawn * least_share:
            raise RefusedError(_explain(constraints, area.sample(rng, _DRAWS), kept, drawn))
    return np.concatenate(found)[:count] if found else np.zeros((0, area.dof))


def _explain(constraints: Sequence[Constraint], poses: Array, kept: int, drawn: int) -> str:
    shares = [(float(np.mean(c.violation(poses) <= ROUNDING)), c.name) for c in constraints]
    listed = ", ".join(f"'{name}' alone holds for {share:.2%}" for share, name in sorted(shares))
    amount = f"{kept} of {drawn} random poses are feasible" if kept else f"none of {drawn} random poses is feasible"
    return f"{amount}: {listed} of the working area. Move the camera or the target, or loosen a constraint."
