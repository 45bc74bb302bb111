"""The statistical fit: the posterior mean, with noise and the size of the errors from the data where nobody says them.

    x = x_ref + S y,        min_y |Sigma^-1/2 r(x)|^2 + |y / s|^2

S holds the plausible size of each link parameter's error, s one common factor on them; frames, points and camera are
nearly free; parameters with a stated prior have that one instead. This is the maximum a posteriori of an empirical
Bayes model ([Morris1983]): the unknown noise of each group in Sigma, and s, are those of largest marginal likelihood of
the model linearised at the estimate (`symcal.fit.variance_components`). Estimate and variances are found in
turn, each from a minimisation with exact derivatives; changes of the variances that swing to and fro are halved, and a
fit whose variances have not settled says so. With a robust loss the noise comes from the median of the residuals
instead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError, RefusedError
from symcal.fit.identifiability import Identifiability, analyse
from symcal.fit.noise import known_sigma, unknown_noise
from symcal.fit.options import Options as Options
from symcal.fit.posterior import Posterior, posterior_of
from symcal.fit.redundancy import check_redundancy
from symcal.fit.remainder_posterior import RemainderPosterior
from symcal.fit.residual_rows import Rows
from symcal.fit.robust import LOSSES, REDESCENDING, Loss
from symcal.fit.sandwich import sandwich
from symcal.fit.triangles import Triangles
from symcal.fit.variance_components import Components
from symcal.fit.variances import VarianceModel, Variances
from symcal.fit.whitened import LINKS, whitened
from symcal.model.measurement import Setup
from symcal.solvers import SOLVERS
from symcal.solvers.least_squares import Problem, Solution

Array = NDArray[np.float64]

ROUNDS = 60
"""Of variances and estimate in turn, at most."""
SETTLED = 1e-6
"""Change of a log variance or robust weight that ends the rounds."""
_GOOD = 1e-3  # change that a fit may still have when the rounds are used up: a two-thousandth of a sigma
_LOOSE = 1e-2  # of the last change of the log variances: as exactly are they sought in a round
_ROUGH = 1e-6  # relative change of the cost that ends a minimisation while the variances are not yet known
_NO_WORSE = 1e-9  # relative difference of the objective that is rounding


@dataclass(frozen=True, slots=True)
class Fit:
    """An estimate with everything that must accompany it.

    x: errors of all parameters, shape (n,). free: names of the estimated ones. setup: the frames that x refers to.
    loss: of the residuals.
    sigmas: noise per group; estimated: the groups whose sigma came from the data.
    factor: s, the common factor on the plausible sizes of links; factor_estimated: whether it came from the data.
    factors: the same of every group of joint terms.
    posterior: of the free parameters. identifiability: at the estimate, for the sizes as stated.
    dof: equations less the effective number of parameters learnt from them (the trace of the projection).
    chi_squared: sum of squared whitened residuals; about ``dof`` when the noise is right.
    by_group: chi_squared and dof of every noise group.
    weights: robust weight of every residual component, shape (N, m), 1 without robust loss, 0 where nothing was
        measured.
    path: x at the start and after every accepted step, shape (k + 1, n).
    trouble: why the result should not be used, in a sentence; empty when everything converged.
    remainder: what is not known of one that was found with it.
    """

    x: Array
    free: tuple[str, ...]
    setup: Setup
    loss: Loss
    sigmas: dict[str, float]
    estimated: tuple[str, ...]
    factor: float
    factor_estimated: bool
    equations: int
    dof: float
    chi_squared: float
    by_group: Mapping[str, tuple[float, float]]
    identifiability: Identifiability
    posterior: Posterior
    solution: Solution
    weights: Array
    path: Array
    trouble: str = ""
    factors: Mapping[str, float] = field(default_factory=dict)
    remainder: RemainderPosterior | None = None

    @property
    def every_factor(self) -> dict[str, float]:
        """Factors on the sizes by group, that of the links among them."""
        return {LINKS: self.factor, **self.factors}

    @property
    def variances(self) -> Variances:
        """All variances as they were found."""
        return Variances(dict(self.sigmas), self.every_factor, self.weights)

    @property
    def iterations(self) -> int:
        return len(self.path) - 1

    @property
    def converged(self) -> bool:
        return not self.trouble

    @property
    def message(self) -> str:
        """How the fit ended, in a sentence."""
        return self.trouble or self.solution.message


def fit(
    rows: Rows,
    free: tuple[str, ...],
    options: Options,
    reference: Array | None = None,
    *,
    prior_mean: Array | None = None,
    nested: Sequence[Array] = (),
    near: tuple[Array, Variances] | None = None,
) -> Fit:
    """Estimate the free parameters; the others stay at ``reference`` (zero if None), to which the free ones are drawn.

    Args:
        prior_mean: the errors at which stated priors are centred, shape (n,); zero if None.
        nested: estimates of models that are contained in this one, shape (n,) each: in the minimised objective none of
            them may be better than the result; where one is, the fit starts again from there.
        near: errors of all parameters, shape (n,), and variances of a fit to data that are much like these, from which
            the rounds start with the linear loss; noise by medians may settle elsewhere: robust losses start as ever.
    Raises:
        RefusedError: fewer equations than unknowns that the data could see, or a model that gives no finite number.
        InputError: the loss is `auto`.
    """
    model = variance_model(rows, free, options, reference, prior_mean=prior_mean)
    reference, rows = model.system.reference, model.system.rows
    if not model.finite(reference):
        raise RefusedError("the model gives no finite number at the first guess: check joint readings and units")
    check_redundancy(rows, free, bool(model.estimated))
    return _Search(model, options).best(reference, nested, near)


def variance_model(
    rows: Rows,
    free: tuple[str, ...],
    options: Options,
    reference: Array | None = None,
    *,
    prior_mean: Array | None = None,
) -> VarianceModel:
    """The system of a fit, and which variances in it are unknown; arguments and errors as of `fit`."""
    if options.loss == "auto":
        raise InputError("an identification chooses the loss; one fit needs one", key="loss", allowed=LOSSES)
    rows = rows.decorrelated()
    nothing = np.zeros(len(rows.measurement.parameters))
    reference = nothing if reference is None else reference
    system = whitened(rows, free, reference, nothing if prior_mean is None else prior_mean)
    known = known_sigma(rows, options.sigma)
    missing = np.isnan(known) & rows.seen
    estimated = unknown_noise(rows, known)
    found = options.shrinking if options.scales == "stated" else tuple(system.groups)
    factors = tuple(name for name, own in system.groups.items() if own.any() and name in found)
    hold = options.loss in REDESCENDING
    triangles = Triangles(system, known) if rows.many else None
    return VarianceModel(system, known, missing, estimated, factors, options.loss, options.shrinking, hold, triangles)


def minimised(model: VarianceModel, options: Options, variances: Variances, start: Array) -> Solution:
    """The minimum of the objective for given variances, in scaled errors, from errors of all parameters, shape (n,)."""
    system, rows = model.system, model.rows_with(variances)

    def evaluate(y: Array) -> tuple[Array, Array]:
        stacked = rows(system.at(y))
        return stacked[:, -1], stacked[:, :-1]

    equations = int(system.rows.seen.sum()) if system.rows.many else None
    problem = Problem(evaluate, system.scaled(start), np.ones(len(system.free)), equations)
    return SOLVERS[options.solver](problem, options.tolerances)


@dataclass(frozen=True, slots=True)
class _Search:
    """A fit under way: what does not change while estimate and variances are found in turn."""

    model: VarianceModel
    options: Options

    def best(self, start: Array, nested: Sequence[Array], near: tuple[Array, Variances] | None = None) -> Fit:
        """The fit from ``start``, or from a nested estimate that the objective prefers to where that one ended."""
        path = [start]
        x, variances, settled = self._first(start, path) if near is None else self._from(near, start, path)
        for _ in nested:
            better = self._better(nested, x, variances)
            if better is None:
                break
            path.append(better)
            x, variances, settled = self._rounds(better, variances, path)
        trouble = "" if settled else "stopped: noise and sizes of the errors did not settle"
        solution, x = self._minimise(x, variances, path, rough=False)
        if not solution.status.converged:
            trouble = solution.message
        elif self._better(nested, x, variances) is not None:
            trouble = "failed: a model with fewer parameters explains the data better"
        return self._finished(x, variances, solution, path, trouble)

    def _first(self, start: Array, path: list[Array]) -> tuple[Array, Variances, bool]:
        """The first rounds; weights that redescend start from where Huber's ended and keep that noise.

        Weights that fall to zero would let the noise fall with them, to where the model passes through half of the
        measurements (an MM estimate, [Yohai1987]). Huber's noise is a little large where there are gross errors: once
        Tukey's weights tell which readings count, the noise is taken from these, and kept again.
        """
        if self.model.loss not in REDESCENDING:
            return self._rounds(start, None, path)
        convex = replace(self, model=replace(self.model, loss="huber", hold=False))
        x, variances, _ = convex._rounds(start, None, path)
        if self.model.estimated:
            strict = replace(self, model=replace(self.model, loss="tukey"))
            x, variances, _ = strict._rounds(x, variances, path)
            variances = strict.model.from_what_counts(x, variances)
        return self._rounds(x, variances, path)

    def _from(self, near: tuple[Array, Variances], start: Array, path: list[Array]) -> tuple[Array, Variances, bool]:
        """The first rounds from what much the same data told, where that is of all that is unknown here."""
        model, system, (x, last) = self.model, self.model.system, near
        told = all(np.isfinite(last.sigmas.get(name, np.nan)) for name in model.estimated) and all(
            name in last.factors for name in system.groups
        )
        if not told or model.settled or model.loss != "linear":
            return self._first(start, path)
        sigmas = dict(self.options.sigma) | {name: last.sigmas[name] for name in model.estimated}
        factors = {name: last.factors[name] if name in model.factors else 1.0 for name in system.groups}
        begin = system.at(system.scaled(x))  # what is held stays
        path.append(begin)
        return self._rounds(begin, Variances(sigmas, factors, system.rows.seen.astype(float)), path)

    def _better(self, nested: Sequence[Array], x: Array, variances: Variances) -> Array | None:
        """The nested estimate of least objective, if that is less than the objective at x."""
        objective = [self._objective(other, variances) for other in nested]
        if not objective or min(objective) >= self._objective(x, variances) * (1 - _NO_WORSE):
            return None
        return nested[int(np.argmin(objective))]

    def _rounds(self, x: Array, last: Variances | None, path: list[Array]) -> tuple[Array, Variances, bool]:
        """Variances and estimate in turn until the variances settle; whether they did."""
        model = self.model
        if last is None:
            last = model.first(x, dict(self.options.sigma), _LOOSE)
            if model.settled:
                return x, last, True
            _, x = self._minimise(x, last, path, rough=True)
        share, before, change = 1.0, np.zeros(0), 1.0
        for _ in range(ROUNDS):
            wanted = model.next(x, last, _LOOSE * change)
            step = model.difference(wanted, last)
            shift = float(np.abs(wanted.weights - last.weights).max(initial=0.0))
            change = min(max(float(np.abs(step).max(initial=0.0)), shift), 1.0)
            if change < SETTLED:
                return x, wanted, True
            if before.size and float(step @ before) < -0.25 * float(before @ before):
                share = max(share / 2, 0.1)  # it swings
            last, before = wanted if share == 1 else last.towards(wanted, share), step
            _, x = self._minimise(x, last, path, rough=change > _GOOD)
        return x, last, change < _GOOD

    def _minimise(
        self, start: Array, variances: Variances, path: list[Array], *, rough: bool
    ) -> tuple[Solution, Array]:
        """The estimate for given variances; the errors after every step are appended to the path."""
        system, options = self.model.system, self.options
        if rough:
            cost = max(options.tolerances.cost, _ROUGH)
            options = replace(options, tolerances=replace(options.tolerances, cost=cost))
        solution = minimised(self.model, options, variances, start)
        path += [system.at(it.x) for it in solution.history[1:]]
        return solution, system.at(solution.x)

    def _objective(self, x: Array, variances: Variances) -> float:
        """|Sigma^-1/2 r|^2 + priors + |y / s|^2 at x."""
        residual = self.model.rows_with(variances)(x)[:, -1]
        return float(residual @ residual)

    def _finished(self, x: Array, variances: Variances, solution: Solution, path: list[Array], trouble: str) -> Fit:
        model, system = self.model, self.model.system
        rows, parameters = system.rows, system.rows.measurement.parameters
        found, blocks = model.at(x, variances)
        data = model.data_rows_with(variances)(x)
        before = system.before
        assumed = system.factors(variances.factors) * before.assumed
        known = np.vstack([before.stated, system.value_rows(x)[:, :-1] / system.scales])
        white = np.zeros((len(data) + len(known), len(parameters)))
        white[: len(data), system.index] = data[:, :-1] / system.scales
        white[len(data) :, system.index] = known
        by_group = self._by_group(x, variances, found)
        return Fit(
            x=x,
            free=system.free,
            setup=rows.setup,
            loss=model.loss,
            sigmas=variances.sigmas,
            estimated=model.estimated,
            factor=variances.factor,
            factor_estimated=LINKS in model.factors,
            equations=int(rows.seen.sum()),
            dof=sum(dof for _, dof in by_group.values()),
            chi_squared=sum(squares for squares, _ in by_group.values()),
            by_group=by_group,
            identifiability=analyse(white, parameters, system.free),
            posterior=posterior_of(
                system.free, system.scales, found, blocks, assumed, self._robust_covariance(x, variances)
            ),
            solution=solution,
            weights=variances.weights,
            path=np.array(path),
            trouble=trouble,
            factors={group: factor for group, factor in variances.factors.items() if group != LINKS},
        )

    def _robust_covariance(self, x: Array, variances: Variances) -> Array | None:
        """Covariance of y with a robust loss, None with the linear one: A^-1 has it then."""
        if self.model.loss == "linear":
            return None
        plain = self.model.spread(replace(variances, weights=self.model.system.rows.seen.astype(float)))
        return sandwich(self.model.system, x, plain, variances.factors, self.model.loss)

    def _by_group(self, x: Array, variances: Variances, found: Components) -> dict[str, tuple[float, float]]:
        """Chi-squared and degrees of freedom of every noise group."""
        out, counts = {}, np.isfinite(self.model.spread(variances))
        rows = self.model.group_rows(x, variances)
        for group in self.model.system.rows.measurement.groups:
            own = rows[group.name]
            taken = float(np.sum((own[:, :-1] @ found.root) ** 2))
            out[group.name] = float(own[:, -1] @ own[:, -1]), int(counts[:, list(group.columns)].sum()) - taken
        return out
