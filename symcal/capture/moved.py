"""Has something moved since some reading? A target that was knocked, an instrument or a base that stands elsewhere.

A place that jumps before reading k is a model with one more place for the readings from k on. With the whitened rows of
all others projected out, the jump that explains most takes b^T A^-1 b off the squared residuals, b = D^T r and
A = D^T (1 - H) D: chi-squared in as many degrees of freedom as the jump has where nothing moved. Every place and each
of the last readings is tried, and the probability counts as often. What is suspected is proved by reading a known pose
again, which no error of the robot's model can imitate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.capture.aim import Aim
from symcal.capture.estimate import Estimate, whitened_rows

Array = NDArray[np.float64]

LOOKED_BACK = 5
"""Last readings among which a jump is looked for."""
SUSPECTED = 1e-3
"""Probability by chance of a jump, over all that are tried, from which on a known pose is read again."""
_TELLING = 1e-9  # of the largest: combinations of a jump's directions that the readings tell anything of


@dataclass(frozen=True, slots=True)
class Jump:
    """of: what jumps, by the stem of its parameters. at: number in the data of the first reading after it. chance: by
    chance, over all that were tried."""

    of: str
    at: int
    chance: float


def jump(aim: Aim, known: Estimate, first: int) -> Jump | None:
    """The likeliest jump before one of the last readings; None where nothing is suspected.

    Args:
        first: number in the data before which nothing has moved, as is known.
    """
    count = len(known.data)
    starts = range(max(first + 1, count - LOOKED_BACK, 1), count)
    stems = dict.fromkeys(name.rpartition("_")[0] for name in aim.model.placement)
    if not starts or known.fit.dof < 1:
        return None
    white, slopes = whitened_rows(aim, known, known.noise)
    white = white.ravel()
    # C of the scaled parameters with what was known before: H = J C J^T
    flat = slopes.reshape(len(white), -1)
    root = np.linalg.cholesky(known.covariance + 1e-15 * np.diag(np.diag(known.covariance)))
    half = flat @ root
    found = []
    for stem in stems:
        own = [i for i, name in enumerate(aim.parameters) if name.rpartition("_")[0] == stem]
        for start in starts:
            jumps = np.zeros((*slopes.shape[:2], len(own)))
            jumps[start:] = slopes[start:][:, :, own]
            jumps = jumps.reshape(len(white), -1)
            across = half.T @ jumps
            left, right = jumps.T @ jumps - across.T @ across, jumps.T @ white
            values, vectors = np.linalg.eigh(left)
            told = values > _TELLING * values[-1]
            explained = float(np.sum((vectors[:, told].T @ right) ** 2 / values[told]))
            found.append(Jump(stem, start, float(scipy.special.chdtrc(int(told.sum()), explained))))
    best = min(found, key=lambda each: each.chance)
    likely = min(best.chance * len(found), 1.0)
    return Jump(best.of, best.at, likely) if likely < SUSPECTED else None
