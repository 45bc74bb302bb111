"""The statistical fit: whitened rows, identifiable subspace, minimum-norm gauge, noise from the data.

For given noise sigmas the estimate is

    x = x_ref + S V_1 y,        min_y |Sigma^-1/2 r(x)|^2

with W = Sigma^-1/2 J S = U diag(s) V^T and V_1 the directions with s > 1: what the data cannot see stays at x_ref.
Unknown sigmas are variance
components, one per noise group: sigma_g^2 = |r_g|^2 / (m_g - tr H_gg), iterated to a fixed point ([Koch1999] sec. 3.6).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.identifiability import Identifiability, analyse, decompose
from symcal.least_squares import Problem, Solution, Tolerances
from symcal.measurements import Setup
from symcal.noise import (
    Loss,
    block_sigmas,
    known_sigma,
    robust_weights,
    spread_of,
    variance_components,
)
from symcal.rows import Rows
from symcal.solvers import SOLVERS, SolverName

Array = NDArray[np.float64]

_SUBSPACE_ROUNDS = 8
_NOISE_ROUNDS = 30


@dataclass(frozen=True, slots=True)
class Options:
    """How to fit.

    Sigma: known noise per group (mm, rad), estimated where absent. prior rows come from the parameters' prior sigmas.
    """

    solver: SolverName = "levenberg_marquardt"
    tolerances: Tolerances = field(default_factory=Tolerances)
    loss: Loss = "linear"
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Fit:
    """An estimate with everything that must accompany it.

    x: errors of all parameters, shape (n,). free: names of the estimated ones. setup: the frames that x refers to.
    sigmas: noise per group; estimated: the groups whose sigma came from the data. dof: equations minus rank.
    weights: robust weight of every residual component, shape (N, m), 1 without robust loss, 0 where nothing was
        measured.
    path: x at the start and after every accepted step, shape (k + 1, n).
    """

    x: Array
    free: tuple[str, ...]
    setup: Setup
    sigmas: dict[str, float]
    estimated: tuple[str, ...]
    equations: int
    dof: int
    identifiability: Identifiability
    solution: Solution
    weights: Array
    path: Array

    @property
    def iterations(self) -> int:
        return len(self.path) - 1

    @property
    def chi_squared(self) -> float:
        """Sum of squared whitened residuals; about ``dof`` when the known noise is right."""
        return 2 * self.solution.cost


def fit(rows: Rows, free: tuple[str, ...], options: Options, reference: Array | None = None) -> Fit:
    """Estimate the free parameters; the others, and what the data cannot see, stay at ``reference`` (zero if None).

    Raises:
        RefusedError: fewer equations than unknowns that the data could see, or a model that gives no finite number.
    """
    parameters = rows.measurement.parameters
    reference = np.zeros(len(parameters)) if reference is None else reference
    known = known_sigma(rows, options.sigma)
    estimated = tuple(
        group.name
        for group in rows.measurement.groups
        if np.isnan(known[:, list(group.columns)])[rows.seen[:, list(group.columns)]].any()
    )
    residual, jacobian = rows(reference)
    if not np.isfinite(residual).all():
        raise RefusedError("the model gives no finite number at the first guess: check joint readings and units")
    sigmas = dict(options.sigma) | block_sigmas(rows, residual, estimated, 0)
    weights = rows.seen.astype(float)
    _check_redundancy(rows, jacobian, free, bool(estimated))
    x, path = reference, [reference]
    ranks: list[int] = []
    most: int | None = None
    for _ in range(_NOISE_ROUNDS):
        spread = spread_of(rows, known, sigmas, weights)
        x, solution, seen, steps = _solve(_whitened(rows, free, reference, spread), options, x, most)
        path += steps
        ranks.append(seen.rank - seen.released)
        if len(ranks) > 2 and ranks[-1] == ranks[-3] != ranks[-2]:
            most = min(ranks[-2:])  # a direction on the threshold comes and goes with the noise estimate: leave it out
        residual, jacobian = rows(x)
        dof = int(rows.seen.sum()) + _prior_count(rows, free) - seen.rank
        previous, before = sigmas, weights
        if options.loss != "linear":
            weights = robust_weights(rows, residual, known, sigmas, options.loss)
            sigmas = dict(sigmas) | block_sigmas(rows, residual, estimated, seen.rank)
        elif estimated:
            sigmas = dict(sigmas) | variance_components(rows, residual, jacobian, spread, seen, estimated)
        change = max([abs(np.log(sigmas[g] / previous[g])) for g in estimated], default=0.0)
        if change < 1e-4 and np.abs(weights - before).max() < 1e-3:
            break
    return Fit(
        x=x,
        free=free,
        setup=rows.setup,
        sigmas=sigmas,
        estimated=estimated,
        equations=int(rows.seen.sum()),
        dof=dof,
        identifiability=seen,
        solution=solution,
        weights=weights,
        path=np.array(path),
    )


@dataclass(frozen=True, slots=True)
class _Whitened:
    """The whitened system of the free parameters for given noise: residual rows, then prior rows."""

    rows: Rows
    free: tuple[str, ...]
    reference: Array
    index: NDArray[np.intp]
    scales: Array
    keep: NDArray[np.intp]
    inverse: Array
    prior: Array

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Residual (k,) and Jacobian (k, n) at x."""
        r, jacobian = self.rows(x)
        white = r.ravel()[self.keep] * self.inverse
        slopes = jacobian.reshape(-1, len(x))[self.keep][:, self.index] * self.inverse[:, None]
        held = np.isfinite(self.prior)
        if held.any():
            white = np.concatenate([white, (x[self.index] / self.prior)[held]])
            slopes = np.vstack([slopes, np.diag(1 / self.prior)[held]])
        return white, slopes

    def at(self, basis: Array, y: Array) -> Array:
        """x_ref + basis y."""
        x = self.reference.copy()
        x[self.index] += basis @ y
        return x

    def subspace(self, x: Array, most: int | None) -> Identifiability:
        r, jacobian = self(x)
        every = np.zeros((len(r), len(x)))
        every[:, self.index] = jacobian
        implied = jacobian @ (x - self.reference)[self.index] - r
        parameters = self.rows.measurement.parameters
        return analyse(every, parameters, self.free, implied=implied, poses=len(self.rows.data), most=most)

    def problem(self, basis: Array, start: Array) -> Problem:
        def evaluate(y: Array) -> tuple[Array, Array]:
            r, jacobian = self(self.at(basis, y))
            return r, jacobian @ basis

        return Problem(evaluate, start, np.ones(basis.shape[1]), lambda: self.symbolic(basis))

    def symbolic(self, basis: Array) -> ca.Function:
        """y -> whitened residual, for solvers that differentiate themselves."""
        data, count = self.rows.data, len(self.rows.data)
        y = ca.MX.sym("y", basis.shape[1])
        x = ca.MX(self.reference)
        x[self.index.tolist()] += ca.DM(basis) @ y
        r, _ = self.rows.measurement.residual.map(count)(
            ca.DM(data.q.T),
            ca.repmat(x, 1, count),
            ca.repmat(ca.DM(self.rows.setup.vector), 1, count),
            ca.DM(np.nan_to_num(data.z).T),
        )
        white = ca.vec(r)[self.keep.tolist()] * ca.DM(self.inverse)
        held = np.flatnonzero(np.isfinite(self.prior))
        if held.size:
            white = ca.vertcat(white, x[self.index[held].tolist()] / ca.DM(self.prior[held]))
        return ca.Function("residual", [y], [white])


def _whitened(rows: Rows, free: tuple[str, ...], reference: Array, spread: Array) -> _Whitened:
    parameters = rows.measurement.parameters
    index = parameters.indices(free)
    prior = np.array([np.inf if p.prior_sigma is None else p.prior_sigma for p in parameters.items])
    keep = np.flatnonzero(np.isfinite(spread).ravel())
    return _Whitened(
        rows, free, reference, index, parameters.scales[index], keep, 1 / spread.ravel()[keep], prior[index]
    )


def _solve(
    system: _Whitened, options: Options, start: Array, most: int | None
) -> tuple[Array, Solution, Identifiability, list[Array]]:
    """Minimise over the identifiable subspace, which is found anew at each estimate until it no longer moves."""
    x, rank, last_cost = start, -1, np.inf
    steps: list[Array] = []
    for _ in range(_SUBSPACE_ROUNDS):
        seen = system.subspace(x, most)
        basis = system.scales[:, None] * seen.seen
        first = seen.seen.T @ ((x - system.reference)[system.index] / system.scales)
        solution = SOLVERS[options.solver](system.problem(basis, first), options.tolerances)
        steps += [system.at(basis, it.x) for it in solution.history[1:]]
        previous, x = x, system.at(basis, solution.x)
        moved = float(np.linalg.norm((x - previous)[system.index] / system.scales))
        same_cost = abs(last_cost - solution.cost) <= 1e-9 * (1e-12 + solution.cost)
        if seen.rank == rank and (moved < 1e-6 or same_cost):
            break
        rank, last_cost = seen.rank, solution.cost
    return x, solution, system.subspace(x, most), steps


def _prior_count(rows: Rows, free: tuple[str, ...]) -> int:
    return sum(p.prior_sigma is not None and p.name in free for p in rows.measurement.parameters.items)


def _check_redundancy(rows: Rows, jacobian: Array, free: tuple[str, ...], estimated: bool) -> None:
    parameters = rows.measurement.parameters
    index = parameters.indices(free)
    stacked = jacobian.reshape(-1, len(parameters))[rows.seen.ravel()][:, index] * parameters.scales[index]
    equations = stacked.shape[0] + _prior_count(rows, free)
    _, _, _, rank = decompose(stacked, None)
    if equations <= rank and (estimated or equations < rank or rank == stacked.shape[0] < len(index)):
        per_pose = max(1, equations // max(len(rows.data), 1))
        wanted = len(rows.data) + (rank + 1 - equations + per_pose) // per_pose
        raise RefusedError(
            f"{len(rows.data)} poses give {equations} equations for at least {rank} unknowns: nothing would be left "
            f"to judge the "
            f"fit by; measure at least {wanted} poses (three times as many are sensible), or hold parameters with 'fix'"
        )
