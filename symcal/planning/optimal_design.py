r"""Approximate designs: how a measure over poses, instead of a whole number of them, would be spread at best.

    maximise log psi(M(w)),   M(w) = P/N + sum_k w_k I(q_k),   w >= 0,   sum w = 1

Weights are found by the multiplicative algorithm ([Silvey1978]) and then by vertex exchange, which moves weight from
the worst atom to the best and so drops atoms altogether ([Bohning1986]). Atoms are generated as they are needed: the
poses that the equivalence theorem of [Kiefer1960] finds too good to be left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.planning.criteria import Criterion
from symcal.planning.information import PoseInformation
from symcal.planning.worst_pose import FeasibleSet, largest

Array = NDArray[np.float64]

TOLERANCE = 2e-3
"""Excess at which the search for a design stops: the slack of the bounds, relative."""

_MULTIPLICATIVE = 60  # steps before vertex exchange takes over: they come near quickly and then crawl
_EXCHANGES = 400
_BISECTIONS = 12
_CLOSE = 0.05  # of the best step of an exchange: the next exchange mends the rest
_NEWCOMERS = 24  # atoms added at a time at most
_NEGLIGIBLE = 1e-9  # weight of an atom that is dropped


@dataclass(frozen=True, slots=True)
class ApproximateDesign:
    """Poses with weights. poses: (k, dof). weights: (k,), sum 1. matrix: M(w), information per pose, (n, n).

    excess: max_x tr(slope I(x)) + tr(slope P/N) - 1, its Kiefer-Wolfowitz gap per parameter, with the maximum as far as
    it was searched. No design has a larger psi than psi(matrix) (1 + excess).
    """

    poses: Array
    weights: Array
    matrix: Array
    excess: float


def optimal_design(
    info: PoseInformation,
    criterion: Criterion,
    where: FeasibleSet,
    ground: Array,
    start: Array,
    rng: np.random.Generator,
    *,
    tolerance: float = TOLERANCE,
    rounds: int = 25,
) -> ApproximateDesign:
    """The best measure on a feasible set, for a concave and smooth criterion.

    Args:
        where: the set, with a dense sample. ground: P/N, shape (n, n).
        start: first atoms, shape (k, dof); their information must have full rank.
        tolerance: of the excess at which to stop. rounds: of atom generation at most.
    """
    atoms = np.unique(start, axis=0)
    weights = np.full(len(atoms), 1.0 / len(atoms))
    excess = 1.0
    for turn in range(rounds):
        matrices = info.matrices(atoms)
        # no need to weigh more finely than the atoms deserve
        weights = optimal_weights(criterion, matrices, ground, weights, max(tolerance / 4, excess / 10))
        kept = weights > _NEGLIGIBLE
        atoms, weights, matrices = atoms[kept], weights[kept] / weights[kept].sum(), matrices[kept]
        matrix = np.asarray(ground + np.einsum("k,kij->ij", weights, matrices))
        slope = criterion.slope(matrix)
        values, poses = largest(info.function, slope, where, rng)
        excess = float(values[0] + np.sum(slope * ground) - 1.0)
        if excess < tolerance or turn == rounds - 1:
            values, poses = largest(info.function, slope, where, rng, thorough=True)
            excess = max(excess, float(values[0] + np.sum(slope * ground) - 1.0))
            if excess < tolerance or turn >= rounds - 1:
                break
        threshold = 1.0 - np.sum(slope * ground) + excess / 10
        fresh = poses[values > threshold][:_NEWCOMERS]
        atoms = np.concatenate([atoms, fresh])
        # a little weight for each newcomer, so that the multiplicative steps can find it
        weights = np.concatenate([0.9 * weights, np.full(len(fresh), 0.1 / len(fresh))])
    return ApproximateDesign(atoms, weights, matrix, excess)


def optimal_weights(criterion: Criterion, matrices: Array, ground: Array, weights: Array, tolerance: float) -> Array:
    """The best weights on given atoms, shape (k,).

    Args:
        matrices: I of each atom, shape (k, n, n). weights: where to start, positive.
        tolerance: of max_k tr(slope I_k) + tr(slope P/N) - 1 over the atoms.
    """
    count, n = len(matrices), len(ground)
    flat = matrices.reshape(count, n * n)

    def total(w: Array) -> Array:
        return np.asarray(ground + (w @ flat).reshape(n, n))

    def gains(slope: Array) -> Array:
        return np.asarray(flat @ slope.ravel() + np.sum(slope * ground))

    w = weights / weights.sum()
    for _ in range(_MULTIPLICATIVE):
        gain = gains(criterion.slope(total(w)))
        if gain.max() < 1.0 + tolerance:
            return np.asarray(w)
        w = w * np.maximum(gain, 0.0) ** criterion.power
        w = w / w.sum()
    for _ in range(_EXCHANGES):
        matrix = total(w)
        gain = gains(criterion.slope(matrix))
        up = int(np.argmax(gain))
        if gain[up] < 1.0 + tolerance:
            break
        down = int(np.argmin(np.where(w > 0, gain, np.inf)))
        step = _step(criterion, matrix, (flat[up] - flat[down]).reshape(n, n), float(w[down]))
        w[up] += step
        w[down] = max(w[down] - step, 0.0)
    return np.asarray(w)


def _step(criterion: Criterion, matrix: Array, direction: Array, longest: float) -> float:
    """The best step along a direction of a concave score, in [0, longest], by bisection of its derivative."""

    def rate(t: float) -> float:
        return float(np.sum(criterion.slope(matrix + t * direction) * direction))

    # at the far end the matrix may be singular: come near to it only
    low, high = 0.0, longest
    if np.isfinite(criterion.score(matrix + longest * direction)) and rate(longest) >= 0:
        return longest
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rate(middle) > 0 else (low, middle)
        if high - low < _CLOSE * high:
            break
    return low
