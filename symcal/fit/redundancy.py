"""Whether there are more equations than unknowns, before anything is fitted."""

from __future__ import annotations

import numpy as np

from symcal.errors import RefusedError
from symcal.fit.identifiability import numerical_rank
from symcal.fit.residual_rows import Rows


def check_redundancy(rows: Rows, free: tuple[str, ...], estimated: bool) -> None:
    """Refuse fewer equations than unknowns; joint terms do not count, which shrink to what the data tell of them.

    Args:
        estimated: whether noise must be told from what is left over.
    Raises:
        RefusedError: nothing is left over.
    """
    parameters = rows.measurement.parameters
    index = np.array([i for i in parameters.indices(free) if not parameters.items[i].group], dtype=np.intp)
    linear = rows.at(np.zeros(len(parameters)))
    stacked = linear.weighted(np.where(rows.seen, 1.0, np.inf), index, parameters.scales[index])[:, :-1]
    stated = len(parameters.prior_rows(free)) + len(rows.values(np.zeros(len(parameters)))[0])
    equations, rank, count = int(rows.seen.sum()) + stated, numerical_rank(stacked), len(rows.data)
    if not free or (equations > rank if estimated else equations >= rank > 0):
        return
    unknowns = len(free) if rank == equations else rank  # so few rows cannot tell how many there are to see
    wanted = max(count + 1, (unknowns + 1) * count // max(equations, 1) + 1)
    raise RefusedError(
        f"{count} poses give {equations} equations for at least {rank} unknowns: nothing would be left "
        f"to judge the fit by; measure {wanted} poses or more (three times as many are sensible), or hold "
        "parameters with 'fix'"
    )
