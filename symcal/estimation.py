"""The statistical fit: whitened rows, identifiable subspace, minimum-norm gauge, noise from the data.

For given noise sigmas the estimate is

    x = x_ref + S V_1 y,        min_y |Sigma^-1/2 r(x)|^2

with W = Sigma^-1/2 J S = U diag(s) V^T and V_1 the directions with s > 1: what the data cannot see stays at x_ref. Unknown sigmas are variance
components, one per noise group: sigma_g^2 = |r_g|^2 / (m_g - tr H_gg), iterated to a fixed point ([Koch1999] sec. 3.6).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from symcal.dataset import Dataset
from symcal.errors import RefusedError
from symcal.identifiability import Identifiability, analyse, decompose
from symcal.kernels.batch import BatchFunction, batch_function
from symcal.least_squares import Problem, Solution, Tolerances
from symcal.measurements import Measurement, Setup
from symcal.solvers import SOLVERS, SolverName

Array = NDArray[np.float64]
Loss = Literal["linear", "huber", "cauchy"]

SIGMA_FLOOR = {"position": 1e-9, "orientation": 1e-12, "image": 1e-9}
"""Noise of data that have none (simulations): rounding, in mm, rad, px."""

_SUBSPACE_ROUNDS = 8
_NOISE_ROUNDS = 30
_HUBER_QUANTILE = 0.95  # of the block norm's chi distribution: where a residual starts to count less


@dataclass(frozen=True, slots=True)
class Options:
    """How to fit. sigma: known noise per group (mm, rad), estimated where absent. prior rows come from the parameters' prior sigmas."""

    solver: SolverName = "levenberg_marquardt"
    tolerances: Tolerances = field(default_factory=Tolerances)
    loss: Loss = "linear"
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Fit:
    """An estimate with everything that must accompany it.

    x: errors of all parameters, shape (n,). free: names of the estimated ones. setup: the frames that x refers to.
    sigmas: noise per group; estimated: the groups whose sigma came from the data. dof: equations minus rank.
    weights: robust weight of every residual component, shape (N, m), 1 without robust loss, 0 where nothing was measured.
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


@dataclass(frozen=True, slots=True)
class Rows:
    """Residuals of a dataset: x -> r (N, m) and J (N, m, n); components that were not measured are zero."""

    measurement: Measurement
    data: Dataset
    setup: Setup
    kernel: BatchFunction
    seen: NDArray[np.bool_]

    def __call__(self, x: Array) -> tuple[Array, Array]:
        r, jacobian = self.kernel(self.data.q, x, self.setup.vector, np.nan_to_num(self.data.z))
        return np.where(self.seen, r, 0.0), np.where(self.seen[:, :, None], jacobian, 0.0)


def rows_of(measurement: Measurement, data: Dataset, setup: Setup, kernel: BatchFunction | None = None) -> Rows:
    """The residual rows of a dataset under a setup; a kernel made before may be used again."""
    kernel = kernel or residual_kernel(measurement)
    unseen = np.isnan(data.z) if measurement.kind == "position" else np.zeros((len(data), measurement.rows), dtype=bool)
    return Rows(measurement, data, setup, kernel, ~unseen)


def residual_kernel(measurement: Measurement) -> BatchFunction:
    # a fit of some hundred poses is over before a compiler would be
    return batch_function(measurement.residual, evaluations=0)


def fit(rows: Rows, free: tuple[str, ...], options: Options, reference: Array | None = None) -> Fit:
    """Estimate the free parameters; the others, and what the data cannot see, stay at ``reference`` (zero if None).

    Raises:
        RefusedError: fewer equations than unknowns that the data could see, or a model that gives no finite number.
    """
    parameters = rows.measurement.parameters
    reference = np.zeros(len(parameters)) if reference is None else reference
    known = _known_sigma(rows, options)
    estimated = tuple(
        group.name
        for group in rows.measurement.groups
        if np.isnan(known[:, list(group.columns)])[rows.seen[:, list(group.columns)]].any()
    )
    residual, jacobian = rows(reference)
    if not np.isfinite(residual).all():
        raise RefusedError("the model gives no finite number at the first guess: check joint readings and units")
    sigmas = dict(options.sigma) | _block_sigmas(rows, residual, estimated, 0)
    weights = rows.seen.astype(float)
    _check_redundancy(rows, jacobian, free, bool(estimated))
    x, path = reference, [reference]
    ranks: list[int] = []
    most: int | None = None
    for _ in range(_NOISE_ROUNDS):
        spread = _spread(rows, known, sigmas, weights)
        x, solution, seen, steps = _solve(rows, free, options, reference, x, spread, most)
        path += steps
        ranks.append(seen.rank - seen.released)
        if len(ranks) > 2 and ranks[-1] == ranks[-3] != ranks[-2]:
            most = min(ranks[-2:])  # a direction on the threshold comes and goes with the noise estimate: leave it out
        residual, jacobian = rows(x)
        dof = int(rows.seen.sum()) + _prior_count(rows, free) - seen.rank
        previous, before = sigmas, weights
        if options.loss != "linear":
            weights = _robust_weights(rows, residual, known, sigmas, options.loss)
            sigmas = dict(sigmas) | _block_sigmas(rows, residual, estimated, seen.rank)
        elif estimated:
            sigmas = dict(sigmas) | _variance_components(rows, residual, jacobian, spread, seen, estimated)
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


# --------------------------------------------------------------------------------------------------- one solve, given noise


def _solve(
    rows: Rows,
    free: tuple[str, ...],
    options: Options,
    reference: Array,
    start: Array,
    spread: Array,
    most: int | None,
) -> tuple[Array, Solution, Identifiability, list[Array]]:
    """Minimise over the identifiable subspace, which is found anew at each estimate until it no longer moves."""
    parameters = rows.measurement.parameters
    index = parameters.indices(free)
    scales = parameters.scales[index]
    prior = np.array([np.inf if p.prior_sigma is None else p.prior_sigma for p in parameters.items])[index]
    has_prior = np.isfinite(prior)
    keep = np.isfinite(spread).ravel()
    inverse = 1 / spread.ravel()[keep]

    def whitened(x: Array) -> tuple[Array, Array]:
        r, jacobian = rows(x)
        r_white = r.ravel()[keep] * inverse
        j_white = jacobian.reshape(-1, len(parameters))[keep][:, index] * inverse[:, None]
        if has_prior.any():
            r_white = np.concatenate([r_white, (x[index] / prior)[has_prior]])
            j_white = np.vstack([j_white, np.diag(1 / prior)[has_prior]])
        return r_white, j_white

    def subspace(x: Array) -> Identifiability:
        r, jacobian = whitened(x)
        every = np.zeros((len(r), len(parameters)))
        every[:, index] = jacobian
        return analyse(every, parameters, free, implied=jacobian @ (x - reference)[index] - r, most=most)

    def symbolic(basis: Array, origin: Array) -> ca.Function:
        y = ca.MX.sym("y", basis.shape[1])
        x = ca.MX(reference)
        x[index.tolist()] = ca.DM(origin) + ca.DM(basis) @ y
        count = len(rows.data)
        r, _ = rows.measurement.residual.map(count)(
            ca.DM(rows.data.q.T),
            ca.repmat(x, 1, count),
            ca.repmat(ca.DM(rows.setup.vector), 1, count),
            ca.DM(np.nan_to_num(rows.data.z).T),
        )
        white = ca.vec(r)[np.flatnonzero(keep).tolist()] * ca.DM(inverse)
        if has_prior.any():
            white = ca.vertcat(
                white, (x[index.tolist()] / ca.DM(np.where(has_prior, prior, 1.0)))[np.flatnonzero(has_prior).tolist()]
            )
        return ca.Function("residual", [y], [white])

    x, rank, steps, last_cost = start, -1, [], np.inf
    for _ in range(_SUBSPACE_ROUNDS):
        seen = subspace(x)
        basis = scales[:, None] * seen.seen
        origin = reference[index]

        def at(y: Array, basis: Array = basis) -> Array:
            moved = reference.copy()
            moved[index] = reference[index] + basis @ y
            return moved

        problem = Problem(
            evaluate=lambda y, basis=basis, at=at: (  # type: ignore[misc]
                lambda r, j: (r, j @ basis)
            )(*whitened(at(y))),
            start=seen.seen.T @ ((x - reference)[index] / scales),
            scales=np.ones(seen.rank),
            function=lambda basis=basis, origin=origin: symbolic(basis, origin),  # type: ignore[misc]
        )
        solution = SOLVERS[options.solver](problem, options.tolerances)
        moved = float(np.linalg.norm((at(solution.x) - x)[index] / scales))
        steps += [at(it.x) for it in solution.history[1:]]
        x = at(solution.x)
        settled = seen.rank == rank and (
            moved < 1e-6 or abs(last_cost - solution.cost) <= 1e-9 * (1e-12 + solution.cost)
        )
        rank, last_cost = seen.rank, solution.cost
        if settled:
            break
    return x, solution, subspace(x), steps


# ------------------------------------------------------------------------------------------------------------------ noise


def _known_sigma(rows: Rows, options: Options) -> Array:
    """Known standard deviation of every component, shape (N, m); NaN where the data must tell."""
    known = np.full((len(rows.data), rows.measurement.rows), np.nan)
    for group in rows.measurement.groups:
        known[:, list(group.columns)] = options.sigma.get(group.name, np.nan)
    if rows.data.sigma is not None:
        known = np.where(np.isfinite(rows.data.sigma), rows.data.sigma, known)
    return known


def _spread(rows: Rows, known: Array, sigmas: Mapping[str, float], weights: Array) -> Array:
    """Standard deviation used for whitening, shape (N, m); infinite where nothing was measured or a robust weight is zero."""
    groups = rows.measurement.per_component({g.name: sigmas.get(g.name, np.nan) for g in rows.measurement.groups})
    sigma = np.where(np.isfinite(known), known, groups)
    with np.errstate(divide="ignore"):
        return np.where(rows.seen & (weights > 0), sigma / np.sqrt(weights), np.inf)


def _variance_components(
    rows: Rows, residual: Array, jacobian: Array, spread: Array, seen: Identifiability, estimated: tuple[str, ...]
) -> dict[str, float]:
    index = rows.measurement.parameters.indices(seen.names)
    finite = np.where(np.isfinite(spread), spread, np.inf)
    white = jacobian[:, :, index] * seen.scales / finite[:, :, None]
    u = white @ (seen.seen / seen.seen_values)
    leverage = np.sum(u**2, axis=2)
    out = {}
    for group in rows.measurement.groups:
        if group.name in estimated:
            columns = list(group.columns)
            mask = rows.seen[:, columns]
            redundancy = max(float(np.sum((1 - leverage[:, columns])[mask])), 1e-3)
            variance = float(np.sum(residual[:, columns][mask] ** 2)) / redundancy
            out[group.name] = max(np.sqrt(variance), SIGMA_FLOOR[group.name])
    return out


def _blocks(rows: Rows, values: Array, columns: tuple[int, ...], block: int) -> tuple[Array, NDArray[np.bool_]]:
    """Norms over the blocks of a group, shape (N, k), and which of them were measured."""
    shaped = values[:, list(columns)].reshape(len(values), -1, block)
    return np.linalg.norm(shaped, axis=2), rows.seen[:, list(columns)].reshape(shaped.shape).all(axis=2)


def _block_sigmas(rows: Rows, residual: Array, estimated: tuple[str, ...], rank: int) -> dict[str, float]:
    """Robust sigma per group from the median block norm: median = sigma * sqrt(median of chi-squared)."""
    out = {}
    equations = int(rows.seen.sum())
    for group in rows.measurement.groups:
        if group.name in estimated:
            norms, seen = _blocks(rows, residual, group.columns, group.block)
            scale = np.sqrt(stats.chi2.median(group.block) * max(equations - rank, 1) / equations)
            out[group.name] = max(float(np.median(norms[seen]) / scale), SIGMA_FLOOR[group.name])
    return out


def _robust_weights(rows: Rows, residual: Array, known: Array, sigmas: Mapping[str, float], loss: Loss) -> Array:
    """Weights of iteratively reweighted least squares, one per block, spread over its components."""
    spread = _spread(rows, known, sigmas, np.ones_like(residual))
    white = np.where(np.isfinite(spread), residual / spread, 0.0)
    weights = rows.seen.astype(float)
    for group in rows.measurement.groups:
        norms, _ = _blocks(rows, white, group.columns, group.block)
        t = norms / np.sqrt(stats.chi2.ppf(_HUBER_QUANTILE, group.block))
        w = 1 / np.maximum(t, 1.0) if loss == "huber" else 1 / (1 + t**2)
        weights[:, list(group.columns)] *= np.repeat(w, group.block, axis=1)
    return weights


# ------------------------------------------------------------------------------------------------------------- redundancy


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
            f"{len(rows.data)} poses give {equations} equations for at least {rank} unknowns: nothing would be left to judge the "
            f"fit by; measure at least {wanted} poses (three times as many are sensible), or hold parameters with 'fix'"
        )
