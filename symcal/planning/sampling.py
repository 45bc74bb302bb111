"""Random feasible poses, and how much of the working area each constraint leaves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.planning.area import WorkingArea, draw
from symcal.planning.constraints import ROUNDING, Constraint, feasible

Array = NDArray[np.float64]

_EVEN = 4096  # poses, spread evenly over the area, from which shares are taken


def feasible_shares(area: WorkingArea, constraints: Sequence[Constraint]) -> tuple[float, dict[str, float]]:
    """Share of the working area in which all constraints hold, and in which each of them alone does, by name."""
    poses = area.even(_EVEN)
    alone = {c.name: float(np.mean(c.violation(poses) <= ROUNDING)) for c in constraints}
    return float(np.mean(feasible(constraints)(poses))), alone


def feasible_poses(
    rng: np.random.Generator, area: WorkingArea, constraints: Sequence[Constraint], count: int, *, snap: float = 0.0
) -> Array:
    """Poses that satisfy all constraints, independent and uniform over the feasible part of the area, by rejection.

    Args:
        snap: share of coordinates put at the area's limits (`WorkingArea.snapped`); 0 for uniform poses.
    Returns:
        shape (count, dof), rad and mm.
    Raises:
        RefusedError: too little of the area is feasible; says how much each constraint leaves.
    """
    try:
        return draw(area, rng, count, feasible(constraints), share=snap)
    except RefusedError as refusal:
        shares = sorted(feasible_shares(area, constraints)[1].items(), key=lambda item: item[1])
        listed = ", ".join(f"'{name}' {share:.3g} %" for name, share in ((n, 100 * s) for n, s in shares))
        raise RefusedError(
            f"{refusal}. Shares of the working area where each constraint alone holds: {listed}"
        ) from None
