"""Whether there are more equations than unknowns, before anything is fitted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.fit.identifiability import numerical_rank
from symcal.fit.residual_rows import Rows

Array = NDArray[np.float64]


def check_redundancy(rows: Rows, free: tuple[str, ...], estimated: bool) -> None:
    """Refuse fewer equations than unknowns; joint terms do not count, which shrink to what the data tell of them.

    Args:
        estimated: whether noise must be told from what is left over.
    Raises:
        RefusedError: nothing is left over.
    """
    parameters = rows.measurement.parameters
    index = np.array([i for i in parameters.indices(free) if not parameters.items[i].group], dtype=np.intp)
    stated = len(parameters.prior_rows(free)) + len(rows.values(np.zeros(len(parameters)))[0])
    equations, count = int(rows.seen.sum()) + stated, len(rows.data)
    if not free or (rows.many and equations > len(index) and (estimated or _seen_at_all(rows, index))):
        return
    rank = numerical_rank(_unit_rows(rows, index))
    if equations > rank if estimated else equations >= rank > 0:
        return
    unknowns = len(free) if rank == equations else rank  # so few rows cannot tell how many there are to see
    wanted = max(count + 1, (unknowns + 1) * count // max(equations, 1) + 1)
    raise RefusedError(
        f"{count} poses give {equations} equations for at least {rank} unknowns: nothing would be left "
        f"to judge the fit by; measure {wanted} poses or more (three times as many are sensible), or hold "
        "parameters with 'fix'"
    )


def _unit_rows(rows: Rows, index: NDArray[np.intp]) -> Array:
    """Scaled J of some parameters at unit noise, shape (k, n')."""
    parameters = rows.measurement.parameters
    linear = rows.at(np.zeros(len(parameters)))
    return linear.weighted(np.where(rows.seen, 1.0, np.inf), index, parameters.scales[index])[:, :-1]


def _seen_at_all(rows: Rows, index: NDArray[np.intp]) -> bool:
    """Whether the data change with any of the parameters: their rank is above zero."""
    return any(_unit_rows(piece, index).any() for _, piece in rows.pieces())
