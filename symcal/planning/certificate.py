r"""How good a plan provably is, measured against every plan of the feasible set.

M is the plan's mean information per pose, n its size. With an approximate design M_a and the equivalence theorem of
[Kiefer1960],

    log det M* <= log det M_a + max_x tr(I(x) M_a^-1) - n
    D-efficiency = exp((log det M - log det M*) / n)  >=  the same with this bound in place of log det M*
    G-efficiency = n / max_x tr(I(x) M^-1)

(the two are different figures). For another concave criterion psi, homogeneous of degree one, psi(M*) <= psi(M_a) max_x
tr(grad log psi(M_a) I(x)). The maxima over the feasible set are *searched*, by dense sampling and polish with exact
derivatives (`symcal.planning.worst_pose`): the bounds hold up to what such a search misses. Where it is asked for and
possible they are *proven* too (`symcal.planning.proof`): for positions and poses with noise that is constant in world
or tool. Distances between poses and poses that the user insists on do not enter the bounds, which are then pessimistic,
never wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.planning.criteria import Criterion, criterion
from symcal.planning.information import PoseInformation
from symcal.planning.optimal_design import TOLERANCE, ApproximateDesign, optimal_design
from symcal.planning.proof.branch_and_bound import WORK
from symcal.planning.proof.proof import Ceiling, Proof, ceiling, prove_plan, symmetric_inverse
from symcal.planning.worst_pose import THOROUGH_SAMPLE, FeasibleSet, largest
from symcal.words import rounded_down

Array = NDArray[np.float64]

NONE_KNOWN = "none known"

_REGULAR = 1e12  # condition number of an information matrix that can be inverted


@dataclass(frozen=True, slots=True)
class Certificate:
    """How good a plan is at least: as far as it was searched, and as far as it is proven.

    d_efficiency_lower_bound, g_efficiency: see the module. worst_pose: where tr(I M^-1) is largest, shape (dof,).
    logdet_upper_bound: of log det of the mean information per pose of any plan. gap: max_x tr(I M_a^-1) - n.
    criterion: the plan's own, criterion_efficiency_lower_bound: by its own value (ratio to the best possible), None
    where no bound is known. design: the approximate design behind the D bound; own_design: the same for the plan's own
    criterion, None without a bound.
    searched: poses that the maximum was taken over; exhaustive: these are the whole feasible set.
    proof: what is proven; None where nothing was asked to be, or can be: `unproven` then says why, in a few words.
    """

    d_efficiency_lower_bound: float
    g_efficiency: float
    worst_pose: Array
    logdet_upper_bound: float
    gap: float
    criterion: str
    criterion_efficiency_lower_bound: float | None
    design: ApproximateDesign
    own_design: ApproximateDesign | None
    searched: int
    exhaustive: bool
    proof: Proof | None = None
    unproven: str = ""

    @property
    def statement(self) -> str:
        """The certificate in words."""
        how = (
            f"over all {self.searched} poses to choose from"
            if self.exhaustive
            else f"searched over {self.searched} sampled poses and polished with exact derivatives"
        )
        own = self.criterion_efficiency_lower_bound
        bound = NONE_KNOWN if own is None else f"{own:.3f}"
        said = (
            f"D-efficiency at least {self.d_efficiency_lower_bound:.3f}, G-efficiency {self.g_efficiency:.3f}, "
            f"bound for criterion {self.criterion}: {bound}; maximum over the feasible set {how}"
        )
        if self.proof is not None:
            left = "" if self.proof.complete else f", {self.proof.open_share:.2%} of the area open"
            return (
                f"{said}; proven over the whole working area: D-efficiency at least {_down(self.proof.d_efficiency)}, "
                f"G-efficiency at least {_down(self.proof.g_efficiency)}, bound for criterion {self.criterion}: "
                f"{_down(self.proof.criterion_efficiency)}{left}"
            )
        return f"{said}; not proven: {self.unproven}" if self.unproven else said


def _down(share: float | None) -> str:
    return NONE_KNOWN if share is None else rounded_down(share)


def certify(
    info: PoseInformation,
    poses: Array,
    merit: Criterion,
    where: FeasibleSet,
    rng: np.random.Generator,
    *,
    designs: tuple[ApproximateDesign | None, ApproximateDesign | None] = (None, None),
    tolerance: float = TOLERANCE,
    prove: bool = False,
    work: int = WORK,
) -> Certificate:
    """The certificate of a plan.

    Args:
        poses: the plan, shape (N, dof). merit: the criterion that it was made for.
        where: the feasible set with a dense sample. tolerance: of the bounds' slack, relative.
        designs: D-optimal and optimal for ``merit``, for as many poses and the same set, if they are known already.
        prove: bound the maxima, instead of only searching them; a pose that the search missed then joins the design.
        work: of every proof, see `symcal.planning.proof.branch_and_bound.largest_value`.
    """
    n, count = info.rank, len(poses)
    ground, matrix = info.prior / count, info.total(poses) / count
    by_d = criterion("D")
    start = _starting_atoms(info, where, poses)
    design, best = designs
    if design is None:
        design = optimal_design(info, by_d, where, ground, start, rng, tolerance=tolerance)
    top: Ceiling | None = None
    unproven = ""
    if prove and where.area is not None:
        (for_proof,) = rng.spawn(1)  # what is searched is searched as without a proof
        try:
            top = ceiling(info, design, where, ground, for_proof, tolerance=tolerance, work=work)
        except RefusedError as error:
            unproven = str(error)
        else:
            design, where = top.design, top.where
    gap = n * max(design.excess, 0.0)
    bound = float(by_d.value(design.matrix)) + gap
    efficiency = float(np.exp((by_d.value(matrix) - bound) / n))
    inverse = symmetric_inverse(matrix)
    values, worst = largest(info.function, inverse, where, rng, thorough=True)
    own: float | None = None
    if merit.name in ("D", "O1"):
        own, best = efficiency**merit.root, design
    elif merit.concave and merit.smooth:
        if best is None:
            best = optimal_design(info, merit, where, ground, start, rng, tolerance=tolerance)
        upper = float(merit.score(best.matrix)) + np.log1p(max(best.excess, 0.0))
        own = float(np.exp((merit.score(matrix) - upper) * merit.root))
    proof = None
    if top is not None:
        proof, higher = prove_plan(info, poses, (matrix, inverse), merit, top, float(values[0]), best, for_proof, work)
        if higher is not None and (where.feasible is None or where.feasible(higher[None])[0]):
            values, worst = info.function.weighted(higher[None], inverse), higher[None]
    return Certificate(
        d_efficiency_lower_bound=efficiency,
        g_efficiency=float(n / (values[0] + np.sum(inverse * ground))),
        worst_pose=worst[0],
        logdet_upper_bound=bound,
        gap=gap,
        criterion=merit.name,
        criterion_efficiency_lower_bound=own,
        design=design,
        own_design=best,
        searched=len(where.sample) + (0 if where.area is None else THOROUGH_SAMPLE),
        exhaustive=where.area is None,
        proof=proof,
        unproven=unproven,
    )


def smallest_variance(
    info: PoseInformation,
    weight: Array,
    matrix: Array,
    ground: Array,
    where: FeasibleSet,
    rng: np.random.Generator,
) -> float:
    """A lower bound of tr(W M^-1) over the mean information M per pose of all plans on a feasible set.

    tr(W M^-1) >= tr(W M_a^-1)^2 / (max_x tr(M_a^-1 W M_a^-1 I(x)) + tr(M_a^-1 W M_a^-1 P/N)) for every M_a; tight
    where M_a is optimal for W.

    Args:
        weight: W, symmetric, not negative, shape (n, n). matrix: M_a. ground: P/N.
    """
    inverse = np.linalg.inv(matrix)
    middle = np.asarray(inverse @ weight @ inverse)
    values, _ = largest(info.function, middle, where, rng, thorough=True)
    return float(np.sum(weight * inverse) ** 2 / (values[0] + np.sum(middle * ground)))


def _starting_atoms(info: PoseInformation, where: FeasibleSet, poses: Array) -> Array:
    """The plan's own poses if they determine everything, else with an even choice of the sample."""
    if np.linalg.cond(info.total(poses)) < _REGULAR:
        return poses
    return np.concatenate([poses, where.sample[:: max(len(where.sample) // 200, 1)]])
