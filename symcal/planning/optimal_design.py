r"""Approximate designs: how a measure over poses, instead of a whole number of them, would be spread at best.

    maximise log psi(M(w)),   M(w) = P/N + sum_k w_k I(q_k),   w >= 0,   sum w = 1

With w = u^2 / |u|^2 the weights need no bounds, and L-BFGS finds them with exact gradients. (u_k = 0 is stationary, so
an atom can only be left: those that ought to come back are lifted.) Atoms are generated as they are needed: the poses
that the equivalence theorem of [Kiefer1960] finds too good to be left out, by climbing from the atoms themselves, which
so come to where they belong, and from the best of a sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from symcal.planning.area import Feasible, WorkingArea
from symcal.planning.criteria import Criterion
from symcal.planning.information import PoseInformation
from symcal.planning.refine import walk_back
from symcal.planning.worst_pose import FeasibleSet, largest, maxima

Array = NDArray[np.float64]

TOLERANCE = 5e-4
"""Excess at which the search for a design stops: the slack of the bounds, relative."""

_ITERATIONS = 200  # of L-BFGS per set of atoms
_LIFTS = 4  # times that atoms without weight are given some again
_LIFTED = 0.02  # weight that they get together
_NEWCOMERS = 100  # atoms added at a time at most
_SHARE = 0.05  # weight of all new atoms together
_NEARLY = 0.02  # excess of a design that has nearly all atoms it needs
_LEAST = 1e-12  # weight, so that no atom is lost to the search for weights
_SETTLING = 40  # steps of atoms and weights together
_KNOWN = 300  # maxima that are remembered
_CLIMBS = 150  # samples from which new atoms are looked for, beside the atoms
_TAIL, _TAILS = 3e-3, 30.0  # weight of all the atoms together that are dropped as the lightest; and of the excess


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
    rounds: int = 80,
) -> ApproximateDesign:
    """The best measure on a feasible set, for a concave and smooth criterion.

    Args:
        where: the set, with a dense sample. ground: P/N, shape (n, n).
        start: first atoms, shape (k, dof); their information must have full rank.
        tolerance: of the excess at which to stop. rounds: of atom generation at most.
    """
    atoms = np.unique(start, axis=0)
    weights = np.full(len(atoms), 1.0 / len(atoms))
    excess, wide = 1.0, False
    known = atoms[:0]  # where maxima were: those that are no atoms may become some, and constraints hide them
    for turn in range(rounds):
        # no need to weigh more finely than the atoms deserve
        fine = max(tolerance / 4, excess / 10)
        matrices = info.matrices(atoms)
        weights = optimal_weights(criterion, matrices, ground, weights, fine)
        order = np.argsort(weights, kind="stable")
        kept = np.sort(order[np.cumsum(weights[order]) > min(_TAIL, excess / _TAILS)])
        atoms, matrices = atoms[kept], matrices[kept]
        weights = optimal_weights(criterion, matrices, ground, weights[kept], fine)
        if where.area is not None:
            atoms, weights = _settled(info, criterion, where.area, where.feasible, ground, atoms, weights)
            matrices = info.matrices(atoms)
            weights = optimal_weights(criterion, matrices, ground, weights, fine)
        matrix = np.asarray(ground + np.einsum("k,kij->ij", weights, matrices))
        slope = criterion.slope(matrix)
        values, poses = maxima(info.function, slope, where, rng, np.concatenate([atoms, known]), _CLIMBS, wide=wide)
        known = poses[:_KNOWN] if where.feasible is not None else known
        before, excess = excess, float(values[0] + np.sum(slope * ground) - 1.0)
        # a maximum out of nothing: constraints hide some, and it takes more to find them
        wide = wide or (before < _NEARLY and excess > 3 * before)
        if excess < tolerance or turn == rounds - 1:
            values, poses = largest(info.function, slope, where, rng, thorough=True)
            known = np.concatenate([known, poses]) if where.feasible is not None else known
            excess = max(excess, float(values[0] + np.sum(slope * ground) - 1.0))
            if excess < tolerance or turn >= rounds - 1:
                break
        threshold = 1.0 - np.sum(slope * ground) + excess / 10
        fresh = poses[values > threshold][:_NEWCOMERS]
        atoms = np.concatenate([atoms, fresh])
        weights = np.concatenate([(1 - _SHARE) * weights, np.full(len(fresh), _SHARE / len(fresh))])
    return ApproximateDesign(atoms, weights, matrix, excess)


def _settled(
    info: PoseInformation,
    criterion: Criterion,
    area: WorkingArea,
    feasible: Feasible | None,
    ground: Array,
    atoms: Array,
    weights: Array,
) -> tuple[Array, Array]:
    """Atoms and weights moved together to where the criterion is better, by a few steps of L-BFGS-B: many atoms beside
    each other are not needed to stand for one between them. Atoms that leave the feasible set are walked back."""
    count, span = len(atoms), area.span
    n = len(ground)

    def loss(x: Array) -> tuple[float, Array]:
        u, unit = x[:count], x[count:].reshape(count, -1)
        poses = area.lower + span * unit
        size = float(u @ u)
        w = u * u / size
        rows = info.rows(poses)
        flat = (np.sqrt(w)[:, None, None] * rows).reshape(-1, n)
        matrix = ground + flat.T @ flat
        value = float(criterion.score(matrix))
        if not np.isfinite(value):
            return 1e30, np.zeros(len(x))
        gain, slope = info.function.weighted_gradient(poses, criterion.slope(matrix))
        by_weight = -2.0 * u / size * (gain - w @ gain)
        return -value, np.concatenate([by_weight, -(w[:, None] * slope * span).ravel()])

    start = np.concatenate([np.sqrt(weights), np.clip(area.unit(atoms), 0.0, 1.0).ravel()])
    bounds = [(None, None)] * count + [(0.0, 1.0)] * (len(start) - count)
    found = minimize(
        loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _SETTLING, "maxcor": 20}
    )
    u, unit = np.asarray(found.x[:count]), np.asarray(found.x[count:]).reshape(count, -1)
    given, weights = weights, u * u / (u @ u)
    moved = np.where(span > 0, area.clip(area.lower + span * unit), atoms)
    if feasible is not None:
        moved = walk_back(atoms, moved, feasible)
        before, after = info.matrices(atoms), info.matrices(moved)
        scores = [
            float(criterion.score(ground + np.einsum("k,kij->ij", w, matrices)))
            for w, matrices in ((given, before), (weights, after))
        ]
        if not scores[1] > scores[0]:
            return atoms, given
    return moved, np.maximum(weights, _LEAST)


def optimal_weights(criterion: Criterion, matrices: Array, ground: Array, weights: Array, tolerance: float) -> Array:
    """The best weights on given atoms, shape (k,).

    Args:
        matrices: I of each atom, shape (k, n, n). weights: where to start, positive.
        tolerance: of max_k tr(slope I_k) + tr(slope P/N) - 1 over the atoms.
    """
    count, n = len(matrices), len(ground)
    upper = np.triu_indices(n)
    twice = np.where(upper[0] == upper[1], 1.0, 2.0)
    flat = np.ascontiguousarray(matrices[:, upper[0], upper[1]])

    def total(w: Array) -> Array:
        matrix = np.zeros((n, n))
        matrix[upper] = w @ flat
        return np.asarray(ground + matrix + np.triu(matrix, 1).T)

    def loss(u: Array) -> tuple[float, Array]:
        size = float(u @ u)
        w = u * u / size
        matrix = total(w)
        value = float(criterion.score(matrix))
        if not np.isfinite(value):
            return 1e30, np.zeros(count)
        gain = flat @ (twice * criterion.slope(matrix)[upper])
        return -value, np.asarray(-2.0 * u / size * (gain - w @ gain))

    w = best = weights / weights.sum()
    least = np.inf
    for _ in range(_LIFTS):
        found = minimize(
            loss,
            np.sqrt(w),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": _ITERATIONS, "maxcor": 20, "ftol": 1e-3 * tolerance / n, "gtol": 0.0},
        )
        u = np.asarray(found.x)
        w = u * u / (u @ u)
        slope = criterion.slope(total(w))
        gain = flat @ (twice * slope[upper]) + np.sum(slope * ground)
        if gain.max() < least:
            best, least = w, float(gain.max())
        if least < 1.0 + tolerance:
            break
        # no more than what is wanted deserves: a lift beyond the optimum costs what was reached
        wanted = np.maximum(gain - 1.0 - tolerance / 2, 0.0)
        share = min(_LIFTED, float(gain.max()) - 1.0)
        w = (1 - share) * w + share * wanted / wanted.sum()
    return np.asarray(best)
