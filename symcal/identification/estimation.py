"""The statistical fit: whitened rows, identifiable subspace, minimum-norm gauge, noise from the data.

For given noise sigmas the estimate is

    x = x_ref + S V_1 y,        min_y |Sigma^-1/2 r(x)|^2

with W = Sigma^-1/2 J S = U diag(s) V^T and V_1 the directions with s > 1: what the data cannot see stays at x_ref.
Subspace, estimate and unknown sigmas (see `symcal.identification.noise`) are found in turn until none of them moves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.identification.identifiability import RELEASE_LIMIT, Identifiability, analyse, decompose
from symcal.identification.noise import (
    Loss,
    block_sigmas,
    known_sigma,
    robust_weights,
    spread_of,
    variance_components,
)
from symcal.identification.rows import Rows
from symcal.least_squares import Problem, Solution, Tolerances
from symcal.measurements import Setup
from symcal.solvers import SOLVERS, SolverName

Array = NDArray[np.float64]

_ROUNDS = 60
_SPARE = 10  # equations beyond the unknowns that noise is first estimated from
_ROUGH = 1e-10  # relative change of the cost that ends a minimisation whose noise is not yet known


@dataclass(frozen=True, slots=True)
class Options:
    """How to fit.

    sigma: known noise per group (mm, rad), estimated where absent. Prior rows come from the parameters' prior sigmas.
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


def fit(
    rows: Rows,
    free: tuple[str, ...],
    options: Options,
    reference: Array | None = None,
    *,
    prior_mean: Array | None = None,
    threshold: float = 1.0,
) -> Fit:
    """Estimate the free parameters; the others, and what the data cannot see, stay at ``reference`` (zero if None).

    Args:
        prior_mean: the errors at which priors are centred, shape (n,); zero if None.
        threshold: smallest singular value of an identifiable direction.
    Raises:
        RefusedError: fewer equations than unknowns that the data could see, or a model that gives no finite number.
    """
    rows = rows.decorrelated()
    nothing = np.zeros(len(rows.measurement.parameters))
    reference = nothing if reference is None else reference
    prior_mean = nothing if prior_mean is None else prior_mean
    known = known_sigma(rows, options.sigma)
    estimated = tuple(
        group.name
        for group in rows.measurement.groups
        if np.isnan(known[:, list(group.columns)])[rows.seen[:, list(group.columns)]].any()
    )
    x = reference
    residual, jacobian = rows(x)
    if not np.isfinite(residual).all():
        raise RefusedError("the model gives no finite number at the first guess: check joint readings and units")
    sigmas = dict(options.sigma) | block_sigmas(rows, residual, known, estimated, 0)
    weights = rows.seen.astype(float)
    _check_redundancy(rows, jacobian, free, bool(estimated))
    path = [x]
    ranks: list[int] = []
    cost = np.inf
    settled = not estimated and options.loss == "linear"  # is the noise?
    # Large errors of the nominal robot look like noise, and noise hides the directions that would explain them. So
    # directions first count up to absurd errors, as far as enough equations are left over to tell the noise.
    bar = threshold / RELEASE_LIMIT if estimated else threshold
    most = max(int(rows.seen.sum()) + _prior_count(rows, free) - _SPARE, 0) if estimated else None
    for _ in range(_ROUNDS):
        spread = spread_of(rows, known, sigmas, weights)
        system = _whitened(rows, free, reference, prior_mean, spread)
        seen = system.subspace(x, most, bar)
        solution, steps = _minimise(system, seen, x, options, rough=not settled)
        path += steps
        previous, x = x, system.at(system.scales[:, None] * seen.seen, solution.x)
        ranks.append(seen.rank - seen.released)
        if len(ranks) > 2 and ranks[-1] == ranks[-3] != ranks[-2]:
            most = min(ranks[-2:])  # a direction on the threshold comes and goes with the noise estimate: leave it out
        same_rank = len(ranks) > 1 and ranks[-1] == ranks[-2]
        if settled and same_rank:
            moved = float(np.linalg.norm((x - previous)[system.index] / system.scales))
            if moved < 1e-6 or abs(cost - solution.cost) <= 1e-9 * (1e-12 + solution.cost):
                break
        if not settled or (estimated and not same_rank):
            residual, jacobian = rows(x)
            last, before = sigmas, weights
            if options.loss != "linear":
                weights = robust_weights(rows, residual, known, sigmas, options.loss)
                sigmas = sigmas | block_sigmas(rows, residual, known, estimated, seen.rank)
            elif estimated:
                sigmas = sigmas | variance_components(rows, residual, jacobian, known, spread, seen, estimated)
            change = max([abs(np.log(sigmas[g] / last[g])) for g in estimated], default=0.0)
            settled = change < 1e-4 and float(np.abs(weights - before).max()) < 1e-3
            if bar < threshold and change < 1e-2:
                ranks, most, bar, settled = [], None, threshold, False
        cost = solution.cost
    return Fit(
        x=x,
        free=free,
        setup=rows.setup,
        sigmas=sigmas,
        estimated=estimated,
        equations=int(rows.seen.sum()),
        dof=int(rows.seen.sum()) + _prior_count(rows, free) - seen.rank,
        identifiability=seen,
        solution=solution,
        weights=weights,
        path=np.array(path),
    )


def moved(found: Fit, rows: Rows, options: Options, start: Array, prior_mean: Array) -> Fit:
    """The same fit at another point of its gauge; noise, weights and rank are kept.

    Args:
        start: shape (n,): the estimate moved along directions that the data do not see.
    """
    rows = rows.decorrelated()
    known = known_sigma(rows, options.sigma)
    spread = spread_of(rows, known, found.sigmas, found.weights)
    system = _whitened(rows, found.free, start, prior_mean, spread)
    rank = found.identifiability.rank
    seen = system.subspace(start, rank, 0.0)
    solution, steps = _minimise(system, seen, start, options, rough=False)
    x = system.at(system.scales[:, None] * seen.seen, solution.x)
    seen = replace(replace(system, reference=x).subspace(x, rank, 0.0), released=found.identifiability.released)
    path = np.array([*found.path, start, *steps])
    return replace(found, x=x, identifiability=seen, solution=solution, path=path)


def _minimise(
    system: _Whitened, seen: Identifiability, start: Array, options: Options, *, rough: bool
) -> tuple[Solution, list[Array]]:
    """Minimise over the identifiable subspace at ``start``; also the errors after every step.

    rough: to a hundred-thousandth of a sigma, while the noise is still being estimated.
    """
    basis = system.scales[:, None] * seen.seen
    first = seen.seen.T @ ((start - system.reference)[system.index] / system.scales)
    tolerances = options.tolerances
    if rough:
        tolerances = replace(tolerances, cost=max(tolerances.cost, _ROUGH))
    solution = SOLVERS[options.solver](system.problem(basis, first), tolerances)
    return solution, [system.at(basis, it.x) for it in solution.history[1:]]


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
    prior_mean: Array

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Residual (k,) and Jacobian (k, n) at x."""
        r, jacobian = self.rows(x)
        white = r.ravel()[self.keep] * self.inverse
        slopes = jacobian.reshape(r.size, len(x))[np.ix_(self.keep, self.index)] * self.inverse[:, None]
        if len(self.prior):
            white = np.concatenate([white, self.prior @ (x - self.prior_mean)[self.index]])
            slopes = np.vstack([slopes, self.prior])
        return white, slopes

    def at(self, basis: Array, y: Array) -> Array:
        """x_ref + basis y."""
        x = self.reference.copy()
        x[self.index] += basis @ y
        return x

    def subspace(self, x: Array, most: int | None, threshold: float) -> Identifiability:
        r, jacobian = self(x)
        every = np.zeros((len(r), len(x)))
        every[:, self.index] = jacobian
        implied = jacobian @ (x - self.reference)[self.index] - r
        return analyse(
            every,
            self.rows.measurement.parameters,
            self.free,
            threshold=threshold,
            implied=implied,
            poses=len(self.rows.data),
            most=most,
        )

    def problem(self, basis: Array, start: Array) -> Problem:
        def evaluate(y: Array) -> tuple[Array, Array]:
            r, jacobian = self(self.at(basis, y))
            return r, jacobian @ basis

        return Problem(evaluate, start, np.ones(basis.shape[1]))


def _whitened(rows: Rows, free: tuple[str, ...], reference: Array, prior_mean: Array, spread: Array) -> _Whitened:
    parameters = rows.measurement.parameters
    index = parameters.indices(free)
    keep = np.flatnonzero(np.isfinite(spread).ravel())
    return _Whitened(
        rows=rows,
        free=free,
        reference=reference,
        index=index,
        scales=parameters.scales[index],
        keep=keep,
        inverse=1 / spread.ravel()[keep],
        prior=parameters.prior_rows(free),
        prior_mean=prior_mean,
    )


def _prior_count(rows: Rows, free: tuple[str, ...]) -> int:
    return len(rows.measurement.parameters.prior_rows(free))


def _check_redundancy(rows: Rows, jacobian: Array, free: tuple[str, ...], estimated: bool) -> None:
    parameters = rows.measurement.parameters
    index = parameters.indices(free)
    stacked = jacobian.reshape(rows.seen.size, len(parameters))[rows.seen.ravel()][:, index] * parameters.scales[index]
    equations = stacked.shape[0] + _prior_count(rows, free)
    _, _, _, rank = decompose(stacked, None)
    if equations <= rank and (estimated or equations < rank or rank == stacked.shape[0] < len(index)):
        unknowns = len(index) if rank == equations else rank  # so few rows cannot tell how many there are to see
        wanted = max(len(rows.data) + 1, (unknowns + 1) * len(rows.data) // max(equations, 1) + 1)
        raise RefusedError(
            f"{len(rows.data)} poses give {equations} equations for at least {rank} unknowns: nothing would be left "
            f"to judge the fit by; measure {wanted} poses or more (three times as many are sensible), or hold "
            "parameters with 'fix'"
        )
