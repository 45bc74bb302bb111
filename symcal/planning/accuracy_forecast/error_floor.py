"""The predicted error that no plan of a given size is below.

The mean over the region is tr(W M^-1) with the region's W: `symcal.planning.certificate.smallest_variance` bounds it.
The worst error is at least every average over the region: the plain one, and the one over the poses and weights of a
D-optimal design as far as they lie in the region. The latter is tight for positions that are measured and asked about
over one area, where it is the equivalence theorem.

They are bounds of the posterior error too: if somebody told what the unseen directions are, it would only fall, and
what is left is the error of the seen ones with their plausible sizes as prior P.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from symcal.planning.certificate import smallest_variance
from symcal.planning.criteria import criterion
from symcal.planning.information import PoseInformation
from symcal.planning.optimal_design import ApproximateDesign, optimal_design
from symcal.planning.region import Accuracy
from symcal.planning.worst_pose import FeasibleSet

Array = NDArray[np.float64]

_SLACK = 2e-3  # of the floor, relative: it is drawn, and no plan is judged by it


@dataclass(frozen=True, slots=True)
class ErrorFloor:
    """Lower bounds of predicted errors; made by `error_floor`.

    prior: P, shape (n, n), with plausible sizes.
    terms: per bound (tr(W M_a^-1)^2, max_x tr(V I(x)), V) with V = M_a^-1 W M_a^-1; the first is for the mean.
    logdet_upper_bound: of log det of the mean information per pose, for plans without priors.
    designs: the approximate designs behind the bounds, by criterion.
    """

    prior: Array
    terms: tuple[tuple[float, float, Array], ...]
    logdet_upper_bound: float
    designs: Mapping[str, ApproximateDesign] = field(default_factory=dict)

    def mean(self, count: int) -> float:
        """Of the root mean square error over the region, mm."""
        return self._bound(count, *self.terms[0])

    def worst(self, count: int) -> float:
        """Of the rms error at the region's worst pose, mm."""
        return max(self._bound(count, *term) for term in self.terms)

    def _bound(self, count: int, square: float, largest: float, middle: Array) -> float:
        return math.sqrt(square / (count * largest + float(np.sum(middle * self.prior))))


def error_floor(
    info: PoseInformation,
    accuracy: Accuracy,
    where: FeasibleSet,
    rng: np.random.Generator,
    near: ApproximateDesign | None = None,
) -> ErrorFloor:
    """Bounds for every number of poses at once.

    Args:
        where: the feasible set with a dense sample, in which maxima are searched (see `symcal.planning.worst_pose`).
        near: a D-optimal design of one number of poses on the same set, if there is one: where to begin, and without
            priors the design itself.
    """
    start = where.sample[:: max(len(where.sample) // 200, 1)]
    atoms = start if near is None else near.poses
    # the bounds hold for any design: the ones without priors serve every number of poses
    none = np.zeros_like(info.prior)
    ground = _RIDGE * info.total(start) / len(start)
    if near is not None and not info.prior.any() and near.excess <= _SLACK:
        by_worst = near
    else:
        by_worst = optimal_design(info, criterion("D"), where, ground, atoms, rng, tolerance=_SLACK)
    by_mean_of = criterion("I", accuracy=accuracy)
    by_mean = optimal_design(info, by_mean_of, where, ground, by_worst.poses, rng, tolerance=_SLACK)
    weighted = [(accuracy.mean, by_mean)]
    spread = _spread(accuracy, by_worst)
    if spread is not None:
        weighted.append((spread, by_worst))
    terms = []
    for weight, design in weighted:
        inverse = np.linalg.inv(design.matrix)
        square = float(np.sum(weight * inverse) ** 2)
        bound = smallest_variance(info, weight, design.matrix, none, where, rng)
        terms.append((square, square / bound, np.asarray(inverse @ weight @ inverse)))
    logdet = float(np.linalg.slogdet(by_worst.matrix)[1]) + info.rank * max(by_worst.excess, 0.0)
    known = info.sizes @ info.basis
    return ErrorFloor(known.T @ known, tuple(terms), logdet, {"I": by_mean, "D": by_worst})


_RIDGE = 1e-9  # of typical information: keeps designs regular that would only determine everything with priors


def _spread(accuracy: Accuracy, design: ApproximateDesign) -> Array | None:
    """Mean of A^T A over the poses of a design that lie in the region, weighted as there; None if none do."""
    region = accuracy.region
    if region.area is None:
        return None
    inside = region.area.contains(design.poses)
    if region.feasible is not None:
        inside = inside & region.feasible(design.poses)
    if not inside.any():
        return None
    rows = accuracy.function.rows(design.poses[inside])
    weights = design.weights[inside] / design.weights[inside].sum()
    return np.asarray(np.einsum("k,kci,kcj->ij", weights, rows, rows, optimize=True))
