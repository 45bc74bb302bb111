"""Whether an instrument or its target was moved within a set: two blocks of poses, each with frames of its own.

The sums that the fit of frames needs are added up over poses, so that every place of the break costs two small fits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.mistakes.hypotheses import Hypothesis
from symcal.calibration.mistakes.rotation_fit import COUNT
from symcal.calibration.mistakes.scene import some
from symcal.calibration.mistakes.sight import Sight

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SPARE = 15.0  # equations beyond the unknowns of the frames, in each block
_POSES = 400
_PLACES = 60  # that a break is first looked for at


def broken(
    sight: Sight, q: Array, z: Array, rows: Mask, labels: tuple[str, ...]
) -> tuple[Hypothesis, float, float] | None:
    """The break that explains most, with the score and the rms that it leaves; None where there are too few poses.

    Args:
        q: joint readings in the order of their file, shape (N, dof). z: own readings, shape (N, w). rows: that count.
    """
    at = some(rows, _POSES)
    each = sight.sums(sight.chain(q[at]), z[at], np.ones(len(at), dtype=bool))
    running = [(np.vstack([np.zeros(of.shape[1]), np.cumsum(of, axis=0)]), located) for of, located in each]
    spare = np.array([sight.spare([(of[m], located) for of, located in running]) for m in range(len(at) + 1)])
    rest = np.array([sight.spare([(of[-1] - of[m], at_) for of, at_ in running]) for m in range(len(at) + 1)])
    enough = (spare >= _SPARE) & (rest >= _SPARE)
    places = np.flatnonzero(enough)
    if not len(places):
        return None
    few = some(enough, _PLACES)
    best = few[int(np.argmin(_left(sight, running, few)[0]))]
    near = places[np.abs(places - best) <= len(places) // _PLACES + 1]
    score, rms = _left(sight, running, near)
    i = int(np.argmin(score))
    text = f"the instrument or its target stood elsewhere from pose '{labels[at[near[i]]]}' on (or the robot did)"
    return Hypothesis("moved", text), float(score[i]), float(rms[i])


def _left(sight: Sight, running: list[tuple[Array, bool]], places: NDArray[np.intp]) -> tuple[Array, Array]:
    """Score and rms of both blocks together by place of the break, shape (K,) each."""
    square, rms, total = np.zeros(len(places)), np.zeros(len(places)), np.zeros(len(places))
    for before in (True, False):
        block = [(of[places] if before else of[-1] - of[places], located) for of, located in running]
        found = sight.fitted(block)
        count = sum(of[:, COUNT] for of, _ in block)
        square, rms, total = square + count * found.score**2, rms + count * found.rms**2, total + count
    return np.sqrt(square / total), np.sqrt(rms / total)
