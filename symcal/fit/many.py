r"""Many identifications with one model at once, from arrays: repetitions, folds, other starts, other plans.

Of every problem the maximum a posteriori for known noise and priors as they are stated,

    min_x |(h(q, x) - z) / sigma|^2 + |P x|^2

the minimum of `symcal.fit.estimation.fit` with known noise and sizes as stated. Compiled, one problem goes in each lane
of the processor's vector registers (`symcal/kernels/fit.h`); else numpy does the same steps. Rows are taken into
triangles by orthogonal reflections; normal equations are never formed. On one machine the bits of a result depend on
its own problem alone: not on how many others are in the call, on their order, or on how a job is cut into calls of the
same form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symcal.errors import InputError, RefusedError
from symcal.fit.many_system import System, system_of
from symcal.kernels.fit import CONVERGED, NOT_FINITE, TOO_MANY, Minima
from symcal.kernels.fit_source import Given, Layout
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.solvers.least_squares import Tolerances
from symcal.solvers.many import minimise_many

Array = NDArray[np.float64]

TOLERANCES = Tolerances(cost=1e-10, iterations=500)
"""The cost is then right to 1e-10 of itself, and errors to 1e-4 of their standard deviation."""

_FINITE = "readings that count must be finite; what was not measured has infinite sigma"
_NOTHING = 1e-20  # of whitened squares: a step of 1e-10 standard deviations
_AT_ONCE = 20_000  # readings whose slopes numpy holds at once


@dataclass(frozen=True)
class ManyFits:
    """R estimates, each with what must accompany it; what takes longer than the fit is computed when it is asked for.

    free: names of the estimated parameters, k of them. x: errors of all parameters, mm and rad, shape (R, n).
    cost: half the squared whitened residuals, priors included, shape (R,). iterations: accepted steps, shape (R,).
    evaluations: of the model, shape (R,). converged: shape (R,). equations: readings that counted, shape (R,).
    factor: R of all whitened rows by the free parameters, R^T R their information, its upper triangle row by row, shape
        (R, k (k + 1) / 2).
    """

    free: tuple[str, ...]
    x: Array
    cost: Array
    iterations: NDArray[np.int64]
    evaluations: NDArray[np.int64]
    converged: NDArray[np.bool_]
    equations: NDArray[np.int64]
    factor: Array = field(repr=False)
    _system: System = field(repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.x)

    def errors(self, problem: int) -> dict[str, float]:
        """Errors of all parameters of one problem by name, mm and rad."""
        return dict(zip(self._system.model.parameters.names, self.x[problem].tolist(), strict=True))

    @cached_property
    def triangle(self) -> Array:
        """R, upper triangular, shape (R, k, k)."""
        k = len(self.free)
        out = np.zeros((len(self.x), k, k))
        rows, columns = np.triu_indices(k)
        out[:, rows, columns] = self.factor
        return out

    @cached_property
    def rank(self) -> NDArray[np.intp]:
        """Directions of which the readings tell more than a plausible size, shape (R,).

        Singular values above 1 of J S / sigma, as many as of R T^-1 with T^T T = P^T P + S^-2 (Sylvester's inertia).
        """
        seen = np.linalg.svd(self.triangle @ np.linalg.inv(self._system.equal), compute_uv=False)
        return np.asarray((seen > 1.0).sum(axis=1))

    @cached_property
    def root(self) -> Array:
        """R^-1, a square root of the covariance, shape (R, k, k)."""
        return np.asarray(np.linalg.inv(self.triangle))

    @cached_property
    def covariance(self) -> Array:
        """R^-1 R^-T, of the free parameters, shape (R, k, k), mm and rad."""
        return np.asarray(np.einsum("rij,rkj->rik", self.root, self.root))

    @cached_property
    def dof(self) -> Array:
        """Equations less the number of parameters learnt from them, k - |P R^-1|^2, shape (R,)."""
        unlearnt = np.einsum("ij,rjk->rik", self._system.prior, self.root)
        return np.asarray(self.equations - len(self.free) + np.sum(unlearnt**2, axis=(1, 2)))


def fit_many(
    model: Model,
    q: ArrayLike,
    z: ArrayLike,
    sigma: ArrayLike,
    *,
    free: tuple[str, ...] | None = None,
    start: ArrayLike | None = None,
    tolerances: Tolerances = TOLERANCES,
    setup: Setup | ArrayLike | None = None,
    strict: bool = True,
) -> ManyFits:
    """Identify the free parameters from R sets of readings with known noise.

    Args:
        q: joint readings of all sets, shape (N, dof), or of each, (R, N, dof). z: readings, shape (R, N, nz), mm, rad
            or px.
        sigma: noise of the residual's components: of all, of each, shape (m,), of each reading, (N, m), or of those of
            each set, (R, N, m). Infinite: does not count, and its reading may be anything, NaN too.
        free: names of the parameters to be found; all that are not held when None.
        start: errors at which the search begins and the other parameters stay, shape (n,) or (R, n); zero when None.
            Priors and sizes are about zero whatever the start.
        tolerances: `cost` is the share of the cost that a step must promise to be worth another look, `iterations` the
            most evaluations; the others do not matter here.
        setup: nominal frames and points; the model's when None. As an array `Setup.vector`, or one for each pose.
        strict: refuse a set of which the search does not converge, instead of saying so in `ManyFits.converged`.
    Raises:
        InputError: arrays that do not fit each other or the model, no such parameter, noise that is not positive,
        readings that count and are not finite. RefusedError: a set does not converge.
    """
    parameters = model.parameters
    if free is not None:
        free = tuple(free)
        unknown = [name for name in free if name not in parameters.names]
        if unknown or not free or len(set(free)) < len(free):
            raise InputError("not parameters, each once", key="free", found=unknown or free, allowed=parameters.names)
    system = system_of(model, free, moved=start is not None)
    if not system.free:
        raise InputError("the task holds every parameter", key="free")
    at = system.nowhere if start is None else _array("start", start)
    frame = system.setup if setup is None else _array("setup", setup.vector if isinstance(setup, Setup) else setup)
    joints, readings = _array("q", q), np.ascontiguousarray(z, dtype=np.float64)
    layout, weights, unit = _checked(system, joints, readings, np.asarray(sigma, dtype=np.float64), at, frame)
    if weights is not None:
        readings = np.nan_to_num(readings, copy=True, posinf=0.0, neginf=0.0)
    kernel = system.kernel(layout)
    small, nothing, budget = tolerances.cost, _NOTHING * unit**2, tolerances.iterations + 1
    if kernel is not None:
        minima = kernel(joints, at, frame, readings, weights, unit, small, nothing, budget)
    else:
        minima = _Numpy(system, joints, at, frame, readings, weights, unit).minima(small, nothing, budget)
    if strict:
        _insist(minima, budget)
    return ManyFits(
        free=system.free,
        x=minima.x,
        cost=minima.cost if unit == 1.0 else minima.cost / unit**2,
        iterations=minima.counts[:, 0],
        evaluations=minima.counts[:, 1],
        converged=minima.counts[:, 2] == CONVERGED,
        equations=_equations(layout, weights, readings, model.measurement.rows),
        factor=minima.factor if unit == 1.0 else minima.factor / unit,
        _system=system,
    )


def _array(key: str, values: ArrayLike) -> Array:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if not _all_finite(array):
        raise InputError("must be finite numbers", key=key, found=f"{_first(~np.isfinite(array))} is not")
    return array


def _all_finite(array: Array) -> bool:
    """By the sum of squares first, which is faster and can overflow."""
    return math.isfinite(np.vdot(array, array)) or bool(np.isfinite(array).all())


def _first(where: NDArray[np.bool_]) -> str:
    """The first place in an array, in brackets."""
    return f"[{', '.join(str(int(i[0])) for i in np.nonzero(where))}]"


def _checked(
    system: System, q: Array, z: Array, sigma: Array, start: Array, setup: Array
) -> tuple[Layout, Array | None, float]:
    """The form of the arrays, weights 1 / sigma or None, and the unit of the rows.

    Rows of one noise are left in its unit, and no number is weighed.
    """
    dof, n, k, nz, m = system.sizes
    if z.ndim != 3 or z.shape[2] != nz or 0 in z.shape[:2]:
        raise InputError(f"readings must have the shape (problems, poses, {nz})", key="z", found=z.shape)
    count, poses = z.shape[:2]
    q_form = _form("q", q, {(poses, dof): "pose", (count, poses, dof): "reading"})
    setup_form = _form("setup", setup, {(k,): "shared", (poses, k): "pose", (count, poses, k): "reading"})
    if start.shape not in ((n,), (count, n)):
        raise InputError(f"must have the shape ({n},) or ({count}, {n})", key="start", found=start.shape)
    if sigma.shape not in ((), (m,), (poses, m), (count, poses, m)):
        allowed = f"() or ({m},) or ({poses}, {m}) or ({count}, {poses}, {m})"
        raise InputError(f"must have the shape {allowed}", key="sigma", found=sigma.shape)
    if not (sigma > 0).all():  # NaN is not, either
        raise InputError("must be positive", key="sigma", found=sigma[~(sigma > 0)].flat[0])
    finite = _all_finite(z)
    if sigma.ndim == 0:
        if not np.isfinite(sigma):
            raise InputError("nothing would count", key="sigma", found=sigma)
        if not finite:
            raise InputError(_FINITE, key="z", found=f"{_first(~np.isfinite(z))} is not")
        return Layout(system.places, q_form, setup_form, None), None, float(sigma)
    if not finite:
        seen = [part.seen(z.reshape(-1, nz)) for part in system.model.measurement.parts]
        bad = ~np.hstack(seen).reshape(count, poses, m) & np.isfinite(sigma)
        if bad.any():
            raise InputError(_FINITE, key="z", found=f"{_first(bad)} is not")
    each = sigma.ndim == 3
    weights = np.ascontiguousarray(np.broadcast_to(1.0 / sigma, sigma.shape if each else (poses, m)))
    return Layout(system.places, q_form, setup_form, "reading" if each else "pose"), weights, 1.0


def _form(key: str, array: Array, forms: dict[tuple[int, ...], Given]) -> Given:
    form = forms.get(array.shape)
    if form is None:
        raise InputError(f"must have the shape {' or '.join(map(str, forms))}", key=key, found=array.shape)
    return form


def _equations(layout: Layout, weights: Array | None, z: Array, m: int) -> NDArray[np.int64]:
    count, poses = z.shape[:2]
    if weights is None:
        return np.full(count, poses * m)
    if layout.weights == "reading":
        return np.asarray(np.count_nonzero(weights, axis=(1, 2)), dtype=np.int64)
    return np.full(count, np.count_nonzero(weights))


def _insist(minima: Minima, budget: int) -> None:
    ends = minima.counts[:, 2]
    if not np.count_nonzero(ends):
        return
    first = int(np.flatnonzero(ends)[0])
    if ends[first] == NOT_FINITE:
        raise RefusedError(f"problem {first}: the model gives no finite number at its start: check readings and units")
    raise RefusedError(f"problem {first}: the search had not converged after {budget} evaluations")


@dataclass(frozen=True, slots=True)
class _Numpy:
    """The same without a compiler; arrays and units as of `symcal.kernels.fit.FitKernel`."""

    system: System
    q: Array
    start: Array
    setup: Array
    z: Array
    weights: Array | None
    unit: float

    def minima(self, small: float, nothing: float, evaluations: int) -> Minima:
        count, poses = self.z.shape[:2]
        index, k = self.system.index, len(self.system.index)
        x = np.array(np.broadcast_to(self.start, (count, self.start.shape[-1])))
        cost, factor = np.empty(count), np.empty((count, k * (k + 1) // 2))
        counts = np.empty((count, 3), dtype=np.int64)
        together = max(_AT_ONCE // poses, 1)
        for first in range(0, count, together):
            some = slice(first, first + together)
            ends = minimise_many(
                lambda which, free, first=first: self.rows(which + first, free),  # type: ignore[misc]
                x[some, index],
                self.system.scales / self.unit,
                small=small,
                nothing=nothing,
                evaluations=evaluations,
            )
            x[some, index], cost[some] = ends.x, ends.cost
            factor[some] = ends.triangles[:, *np.triu_indices(k)]
            how = np.where(ends.converged, CONVERGED, np.where(ends.finite, TOO_MANY, NOT_FINITE))
            counts[some] = np.stack([ends.steps, ends.evaluations, how], axis=1)
        return Minima(x, cost, factor, counts)

    def rows(self, which: NDArray[np.intp], free: Array) -> Array:
        """[J, r] of readings, of what is known, and of priors, of some problems, shape (A, rows, k + 1)."""
        count, poses, k = len(which), self.z.shape[1], len(self.system.index)
        x = np.array(np.broadcast_to(self.start, (len(self.z), self.start.shape[-1]))[which])
        x[:, self.system.index] = free
        r, jacobian = self.system.at(
            self._each(self.q, which),
            np.repeat(x, poses, axis=0),
            self.setup if self.setup.ndim == 1 else self._each(self.setup, which),
            self.z[which].reshape(count * poses, -1),
        )
        known, prior = self._known(x), self.system.prior * self.unit
        own = poses * r.shape[1]
        out = np.empty((count, own + known.shape[1] + k, k + 1))
        out[:, :own, :k] = jacobian.reshape(count, own, k)
        out[:, :own, k] = r.reshape(count, own)
        if self.weights is not None:
            weights = self.weights if self.weights.ndim == 2 else self.weights[which]
            weights = weights.reshape(-1, own, 1)
            out[:, :own] = np.where(weights > 0, out[:, :own] * weights, 0.0)
        out[:, own : own + known.shape[1]] = known
        out[:, own + known.shape[1] :, :k] = prior
        out[:, own + known.shape[1] :, k] = np.sum(prior * free[:, None, :], axis=2)
        return out

    def _known(self, x: Array) -> Array:
        if self.system.known is None:
            return np.zeros((len(x), 0, len(self.system.index) + 1))
        setup = self.setup.reshape(-1, self.setup.shape[-1])[0]
        found = [[np.asarray(each) for each in self.system.known(own, setup)] for own in x]
        return np.stack([np.hstack([jacobian, r]) for r, jacobian in found]) * self.unit

    def _each(self, array: Array, which: NDArray[np.intp]) -> Array:
        """An array of poses for the rows of some problems."""
        whole = np.broadcast_to(array, (len(self.z), *array.shape[-2:]))[which]
        return whole.reshape(-1, array.shape[-1])
