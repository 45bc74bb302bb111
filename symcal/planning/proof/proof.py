r"""What is proven about a plan, where everything else is searched.

For every positive definite W, exact or not,

    log det M* <= max_x tr(I(x) W) + tr(W P/N) - n - log det W,        D-efficiency >= exp((log det M - that) / n)
    G-efficiency >= n / (max_x tr(I(x) M^-1) + tr(M^-1 P/N))

and for another concave criterion psi, homogeneous of degree one, psi(M*) <= psi(M_a) (max_x tr(G I(x)) + tr(G P/N))
with its slope G at M_a. W is the inverse of a nearly optimal M_a. The maxima over the working area are bounded by
`symcal.planning.proof.branch_and_bound`, and rounding is in every bound: of rows, of sums, of determinants.
That the trace is a polynomial follows from what is measured and is tried at random poses, as the joints that it does
not depend on are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.kernels.instructions import read_program
from symcal.planning.criteria import Criterion, criterion
from symcal.planning.information import PoseInformation
from symcal.planning.optimal_design import ApproximateDesign, optimal_design
from symcal.planning.proof.branch_and_bound import WORK, Bound, largest_value
from symcal.planning.proof.running_error import UNIT, evaluate
from symcal.planning.proof.trace_polynomial import TracePolynomial, trace_polynomial
from symcal.planning.subspace_rows import SubspaceRows
from symcal.planning.worst_pose import FeasibleSet, feasible_set

Array = NDArray[np.float64]

SLACK = 1e-4
"""By how much more than the searched maximum is to be proven, relative: it costs a plan as much of its efficiency."""


_SCORED = 1e-9  # rounding of scores, which are logarithms
_REPAIRS = 3  # designs that are made anew because their search had missed a pose


@dataclass(frozen=True, slots=True)
class Proof:
    """Bounds over the whole working area, whatever constraints take away from it.

    d_efficiency, g_efficiency: proven lower bounds. criterion_efficiency: by the plan's own criterion. The latter two
    are None where no bound is known. logdet_upper_bound: of log det of the mean information per pose.
    open_share: of the working area's volume, where the bound of D is above what was to be proven (the bounds are true
    all the same). boxes: that were looked at, for D. joints: that matter. rounding: the margin for it, relative to n.
    missed: poses that the search had missed and the proof found.
    """

    d_efficiency: float
    g_efficiency: float | None
    criterion_efficiency: float | None
    logdet_upper_bound: float
    open_share: float
    boxes: int
    joints: int
    rounding: float
    missed: int = 0

    @property
    def complete(self) -> bool:
        """Whether nothing was left open."""
        return self.open_share == 0.0


@dataclass(frozen=True, slots=True)
class Ceiling:
    """A proven bound of what any plan can reach by D.

    logdet: bound of log det M*. bound: of tr(I(x) W) behind it. joints: that matter. missed: poses that the search had
    missed. design, where: the design and the feasible set with them.
    """

    logdet: float
    bound: Bound
    joints: int
    missed: int
    design: ApproximateDesign
    where: FeasibleSet


def maximum(
    info: PoseInformation, weight: Array, known: float, rng: np.random.Generator, work: int = WORK
) -> tuple[Bound, int]:
    """A bound of the largest tr(I(x) W) over the working area, and how many joints matter.

    Args:
        weight: W, shape (n, n), symmetric. known: the largest value that a search found.
        rng: of the poses at which the polynomial is tried. work: see `largest_value`.
    Raises:
        RefusedError: the trace is no polynomial of degree two, in a few words.
    """
    made = _trace(info, weight, rng)
    return largest_value(made, known, SLACK * abs(known), work=work), len(made.axes)


def _trace(info: PoseInformation, weight: Array, rng: np.random.Generator) -> TracePolynomial:
    return trace_polynomial(info.function, weight, info.area, info.measurement.chain.robot.joints, rng)


def ceiling(
    info: PoseInformation,
    design: ApproximateDesign,
    where: FeasibleSet,
    ground: Array,
    rng: np.random.Generator,
    *,
    tolerance: float,
    work: int = WORK,
) -> Ceiling:
    """The bound by a D-optimal design, which poses that its search had missed join.

    With constraints the bound is that of the whole working area, from a design of its own.

    Args:
        design: D-optimal over ``where``, which has an area. ground: P/N. tolerance: of a design's excess.
    Raises:
        RefusedError: as `maximum` does.
    """
    by_d, own, everywhere = criterion("D"), design, where
    if where.feasible is not None and where.area is not None:
        _trace(info, np.eye(info.rank), rng)  # before a design is made in vain
        everywhere = feasible_set(where.area, rng, len(where.sample))
        own = optimal_design(info, by_d, everywhere, ground, everywhere.sample, rng, tolerance=tolerance)
    missed = 0
    while True:
        weight = symmetric_inverse(own.matrix)
        resting = float(np.sum(weight * ground))
        bound, joints = maximum(info, weight, info.rank * (1.0 + own.excess) - resting, rng, work)
        if bound.pose is None or bound.value is None:
            break
        missed += 1
        own = replace(own, excess=(bound.value + resting) / info.rank - 1.0)
        if missed > _REPAIRS:
            break
        everywhere = replace(everywhere, sample=np.concatenate([bound.pose[None], everywhere.sample]))
        start = np.concatenate([own.poses, bound.pose[None]])
        own = optimal_design(info, by_d, everywhere, ground, start, rng, tolerance=tolerance)
    if where.feasible is None:
        design, where = own, everywhere
    return Ceiling(logdet_ceiling(weight, bound.upper, ground), bound, joints, missed, design, where)


def symmetric_inverse(matrix: Array) -> Array:
    """The inverse of a symmetric matrix, symmetric to the last bit."""
    inverse = np.linalg.inv(matrix)
    return np.asarray(0.5 * (inverse + inverse.T), dtype=np.float64)


def logdet_ceiling(weight: Array, largest: float, ground: Array) -> float:
    """The bound of log det M* that a W gives.

    Args:
        weight: W. largest: a bound of tr(I(x) W). ground: P/N.
    """
    given = largest + float(np.sum(weight * ground)) + 4 * weight.size * UNIT * float(np.sum(np.abs(weight * ground)))
    nothing = np.zeros_like(weight)
    return given - len(weight) - float(np.linalg.slogdet(weight)[1]) + logdet_error(weight, nothing)


def logdet_error(matrix: Array, entries: Array) -> float:
    """Bound of the rounding error of log det of a positive definite matrix, to first order.

    sum |M^-1| |dM|, with the errors of the entries and the backward error of a factorisation ([Higham2002] sec. 10.1).

    Args:
        entries: errors of the entries, shape (n, n), not negative.
    """
    root = np.sqrt(np.diag(matrix))
    backward = 8 * (len(matrix) + 2) * UNIT * np.outer(root, root)
    return 2.0 * float(np.sum(np.abs(np.linalg.inv(matrix)) * (entries + backward)))


def d_efficiency(info: PoseInformation, poses: Array, matrix: Array, ceiling: float) -> float:
    """The proven D-efficiency of a plan, shape (N, dof).

    Args:
        matrix: its information per pose, M. ceiling: a bound of log det of that of any plan.
    """
    assert isinstance(info.function, SubspaceRows)  # or there would be no ceiling
    rows, doubt = evaluate(read_program(info.function.expression), poses)
    basis, p = np.abs(info.basis), len(info.basis)
    size = (np.abs(rows) @ basis).reshape(-1, info.rank)
    error = (doubt @ basis).reshape(-1, info.rank) + 2 * p * UNIT * size
    product = size.T @ error
    entries = (product + product.T + error.T @ error + 2 * (len(size) + 2) * UNIT * (size.T @ size)) / len(poses)
    margin = logdet_error(matrix, entries + 4 * UNIT * np.abs(matrix))
    return float(np.exp((np.linalg.slogdet(matrix)[1] - margin - ceiling) / info.rank))


def prove_plan(
    info: PoseInformation,
    poses: Array,
    mean: tuple[Array, Array],
    merit: Criterion,
    top: Ceiling,
    known: float,
    best: ApproximateDesign | None,
    rng: np.random.Generator,
    work: int = WORK,
) -> tuple[Proof, Array | None]:
    """What is proven about a plan, shape (N, dof), and a pose that is worse for it than the worst that was found.

    Args:
        mean: its information per pose M, and the symmetric inverse of that. merit: its own criterion; best: a nearly
            optimal design for it, None without one. top: the bound by D. known: the largest tr(I(x) M^-1) that a search
            found.
    """
    (matrix, inverse), ground = mean, info.prior / len(poses)
    of_d = d_efficiency(info, poses, matrix, top.logdet)
    worst = _bounded(info, inverse, known, rng, work)
    own = of_d**merit.root if merit.name in ("D", "O1") else None
    other = None
    if own is None and best is not None and merit.concave and merit.smooth:
        slope = merit.slope(best.matrix)
        rest = float(np.sum(slope * ground))
        other = _bounded(info, slope, 1.0 + best.excess - rest, rng, work)
        if other is not None:
            upper = float(merit.score(best.matrix)) + float(np.log(other.upper + rest)) + _SCORED
            own = float(np.exp((merit.score(matrix) - upper) * merit.root))
    proof = Proof(
        d_efficiency=of_d,
        g_efficiency=None if worst is None else g_efficiency(matrix, inverse, worst.upper, ground),
        criterion_efficiency=own,
        logdet_upper_bound=top.logdet,
        open_share=top.bound.open_share,
        boxes=top.bound.boxes,
        joints=top.joints,
        rounding=top.bound.rounding / info.rank,
        missed=top.missed + sum(each is not None and each.pose is not None for each in (worst, other)),
    )
    return proof, None if worst is None else worst.pose


def _bounded(info: PoseInformation, weight: Array, known: float, rng: np.random.Generator, work: int) -> Bound | None:
    """The bound of a trace; None where W is too nearly singular for one."""
    try:
        return maximum(info, weight, known, rng, work)[0]
    except RefusedError:
        return None


def g_efficiency(matrix: Array, inverse: Array, largest: float, ground: Array) -> float:
    """The proven G-efficiency.

    Args:
        matrix: M. inverse: X, nearly its inverse; with M = L L^T, tr(I M^-1) <= tr(I X) / (1 - |L^T X L - 1|).
        largest: a bound of tr(I(x) X). ground: P/N.
    """
    n, root = len(matrix), np.linalg.cholesky(matrix)
    off = float(np.linalg.norm(root.T @ inverse @ root - np.eye(n), 2)) * 2 + 64 * n * n * UNIT
    return (1.0 - off) * n / (largest + float(np.sum(inverse * ground)))
