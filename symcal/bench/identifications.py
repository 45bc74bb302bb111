"""Identifications of one arm from 40 positions each: many at once, and a single one, against SciPy and JAX."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.bench import own_fits
from symcal.bench.arms import handling_robot, random_errors, random_postures
from symcal.bench.case import Case, case_of, identifiable
from symcal.bench.contest import LEFT_OUT, Contest, Entry, Progress, hold
from symcal.bench.peers import casadi_map, jax_arm, numpy_batch, numpy_loop, scipy_fit
from symcal.bench.peers.fit_problem import FitProblem
from symcal.bench.rounds import Contender, Pace

Array = NDArray[np.float64]

SUBJECT = "identifications"
POSES, SIGMA = 40, 0.05
BATCH = 1000
SOME, FEW = 10, 3
"""Identifications that those do in a round who do one after the other, and so many in a quick run."""

EXACT, DIFFERENCES = 1e-8, 1e-4
"""Largest relative difference of a cost from SciPy's at `TIGHT`: with exact slopes, and with finite differences."""
TIGHT = 1e-12
_STEPS = 6  # of Gauss-Newton in JAX: from errors as large as these four are enough

REFERENCE = "SciPy lm, exact slopes (CasADi C)"


@dataclass(frozen=True, slots=True)
class Repeated:
    """One plan measured again and again. q: postures, shape (N, dof). z: positions, shape (R, N, 3), mm.

    problem: the first of them. positions: the arm's at errors x, by NumPy.
    """

    case: Case
    q: Array
    z: Array
    problem: FitProblem

    @property
    def free(self) -> tuple[str, ...]:
        return tuple(self.case.names[i] for i in self.problem.free)

    def of(self, i: int) -> FitProblem:
        return replace(self.problem, z=self.z[i])

    def costs(self, x: Array) -> Array:
        """Of the first identifications, by the errors found for them, shape (k, n): by NumPy alone."""
        positions = partial(numpy_batch.positions, self.case.arm, self.q)
        return np.array([self.of(i).cost(positions(own), own) for i, own in enumerate(x)])


def run(batch: int, pace: Pace, progress: Progress, *, slow: bool) -> Iterator[dict[str, Any]]:
    """The contest on the handling robot; ``slow``: see `contest`.

    Yields:
        its content in bench.json.
    """
    repeated = repeat(case_of(handling_robot()), batch)
    progress(f"identifications of {len(repeated.problem.free)} parameters from {POSES} postures, {batch} at once")
    with casadi_map.compiled(repeated.case.function) as generated:
        yield hold(contest(repeated, generated, slow=slow), pace)


def repeat(case: Case, count: int, poses: int = POSES, seed: int = 2) -> Repeated:
    """Positions of an arm with random errors, with noise drawn so many times."""
    rng = np.random.default_rng(seed)
    free = identifiable(case, rng)
    columns = np.array([case.names.index(name) for name in free])
    x = np.zeros(len(case.names))
    x[columns] = random_errors(free, rng)
    q = random_postures(case.robot, poses, rng)
    z = numpy_batch.positions(case.arm, q, x) + rng.normal(0.0, SIGMA, (count, poses, 3))
    sizes = case.model.parameters.scales
    return Repeated(case, q, z, FitProblem(z[0], SIGMA, columns, len(x), sizes))


def contest(repeated: Repeated, generated: ca.Function | None, *, slow: bool = True) -> Contest:
    """Everybody's first identifications, their costs compared with those of SciPy at `TIGHT`, and how to measure them.

    Args:
        generated: the case's function as CasADi's own C; None where there is no compiler.
        slow: with those that take a tenth of a second and more for one, and JAX, which has to compile.
    """
    case, q, z = repeated.case, repeated.q, repeated.z
    arm, some = case.arm, min(SOME if slow else FEW, len(z))
    tight = [scipy_fit.fit_exact(repeated.of(i), _numpy_slopes(repeated), "lm", TIGHT) for i in range(some)]
    wanted = repeated.costs(np.array(tight))
    entries: list[Entry] = []
    absent: dict[str, str] = {}

    def enter(name: str, what: str, call: Callable[[], Any], items: int, allowed: float = EXACT) -> None:
        found = np.atleast_2d(call())[:some]
        off = float(np.max(np.abs(repeated.costs(found) / wanted[: len(found)] - 1)))
        entries.append(Entry(Contender(name, call, items, what), off, allowed))

    def one_by_one(fit: Callable[[FitProblem], Array], count: int = some) -> Callable[[], Array]:
        return lambda: np.array([fit(repeated.of(i)) for i in range(count)])

    for own in own_fits.entries(case, q, z, SIGMA, repeated.free):
        enter(own.name, own.what, own.call, own.items)
    slopes = _casadi_slopes(repeated, generated or case.function)
    kind = REFERENCE if generated else REFERENCE.replace("CasADi C", "CasADi, virtual machine")
    methods: tuple[Literal["lm", "trf"], ...] = ("lm", "trf")
    for method in methods:
        name = kind.replace("lm", method)
        enter(name, "positions and slopes in one call, cached", one_by_one(_exact(slopes, method)), some)
    readings = partial(numpy_batch.positions, arm, q)
    for method in methods:
        fit = partial(scipy_fit.fit_differences, readings=readings, method=method)
        enter(f"SciPy {method}, 2-point slopes (NumPy)", "all postures at once", one_by_one(fit), some, DIFFERENCES)
    if slow:
        fit = partial(scipy_fit.fit_differences, readings=_posture_by_posture(repeated), method="lm")
        name = "SciPy lm, 2-point slopes (NumPy, pose by pose)"
        enter(name, "4x4 matrices", one_by_one(fit, 1), 1, DIFFERENCES)
        _enter_jax(repeated, enter, absent)
    else:
        absent["JAX"] = LEFT_OUT
    name = f"identification of {len(repeated.problem.free)} parameters from {len(q)} postures"
    return Contest(SUBJECT, name, len(z), "identification", kind, "costs", tuple(entries), absent)


def _enter_jax(repeated: Repeated, enter: Callable[..., None], absent: dict[str, str]) -> None:
    arm, problem, q, z = repeated.case.arm, repeated.problem, repeated.q, repeated.z
    try:
        many = jax_arm.least_squares(arm, problem, _STEPS, many=True)
        one = jax_arm.least_squares(arm, problem, _STEPS, many=False)
    except ImportError:
        absent["JAX"] = "not installed"
        return
    what = f"{_STEPS} Gauss-Newton steps by QR"
    enter(f"JAX, {len(z)} at once", f"jit, vmap, {what}", lambda: many(q, z), len(z))
    enter("JAX, single", f"jit, {what}", lambda: one(q, z[0]), 1)


def _exact(slopes: scipy_fit.Slopes, method: Literal["lm", "trf"]) -> Callable[[FitProblem], Array]:
    return lambda problem: scipy_fit.fit_exact(problem, slopes, method)


def _numpy_slopes(repeated: Repeated) -> scipy_fit.Slopes:
    return partial(numpy_batch.positions_and_slopes, repeated.case.arm, repeated.q)


def _casadi_slopes(repeated: Repeated, function: ca.Function) -> scipy_fit.Slopes:
    """Through a map of all postures with results allocated beforehand; the errors, as all that changes, for each."""
    given = np.zeros((len(repeated.q), len(repeated.case.names)))
    many = casadi_map.mapped(function, (repeated.q, given), (repeated.case.setup,))

    def run(x: Array) -> tuple[Array, Array]:
        given[:] = x
        p, slopes = many()
        return p, slopes.swapaxes(1, 2)

    return run


def _posture_by_posture(repeated: Repeated) -> scipy_fit.Readings:
    return lambda x: np.array([numpy_loop.position(repeated.case.arm, own, x) for own in repeated.q])
