"""The genetic algorithm of [Ding2017] section IV, on plans of many poses at once.

One individual is a whole plan. The paper codes the joint variables in binary and runs 200 generations; population,
bits, operators and their rates are not given there and are ours: 200 individuals, 8 bits, binary tournament, uniform
crossover, bit flips. Real coding (simulated binary crossover and polynomial mutation, [Deb1995]) is the alternative.
The best plans of parents and children survive, so the best fitness never gets worse. Infeasible plans lose against
feasible ones, and against less infeasible ones, whatever their fitness ([Deb2000]).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError

Array = NDArray[np.float64]
Bits = NDArray[np.bool_]
Coding = Literal["binary", "gray", "real"]
PlanFunction = Callable[[Array], Array]
"""(P, N, dof) -> (P,): a number per plan."""
Mixing = Literal["gene", "pose"]
Progress = Callable[[int, float, Array], None]
"""Told the generation (0 is the start), the best fitness so far, and the plan that has it, (N, dof)."""


@dataclass(frozen=True, slots=True)
class GeneticResult:
    """The best plan of a run and how it was reached.

    poses: shape (N, dof), rad and mm. fitness: of that plan; violation: 0 if it is feasible.
    history: fitness of the best plan after each generation, the start first, shape (generations + 1,); it falls while
    the plan is feasible.
    violations: the same for the violation. evaluations: plans whose fitness was computed.
    """

    poses: Array
    fitness: float
    violation: float
    history: Array
    violations: Array
    evaluations: int
    coding: Coding


def decode(bits: Bits, lower: Array, upper: Array, *, gray: bool = False) -> Array:
    """Joint values of bit strings: lower + (upper - lower) k / (2^b - 1), so that both limits are reached exactly.

    Args:
        bits: shape (..., dof, b), most significant first. lower, upper: shape (dof,).
        gray: the code in which neighbouring values differ in one bit.
    Returns:
        shape (..., dof), rad or mm.
    """
    plain = np.logical_xor.accumulate(bits, axis=-1) if gray else bits
    count = bits.shape[-1]
    share = plain @ (2.0 ** np.arange(count - 1, -1, -1)) / (2.0**count - 1)
    return np.asarray(np.where(share == 1.0, upper, lower + (upper - lower) * share))


def encode(values: Array, lower: Array, upper: Array, count: int, *, gray: bool = False) -> Bits:
    """The bit strings, shape (..., dof, count), whose values are nearest to the given ones, shape (..., dof)."""
    width = np.where(upper > lower, upper - lower, 1.0)
    k = np.rint((values - lower) / width * (2**count - 1)).astype(np.int64)
    k = np.clip(k, 0, 2**count - 1)
    if gray:
        k = k ^ (k >> 1)
    return np.asarray((k[..., None] >> np.arange(count - 1, -1, -1)) & 1, dtype=np.bool_)


def genetic(
    fitness: PlanFunction,
    lower: Array,
    upper: Array,
    poses: int,
    rng: np.random.Generator,
    *,
    coding: Coding = "binary",
    mixing: Mixing = "gene",
    bits: int = 8,
    population: int = 200,
    generations: int = 200,
    violation: PlanFunction | None = None,
    start: Array | None = None,
    callback: Progress | None = None,
) -> GeneticResult:
    """Minimise a fitness over plans of ``poses`` poses within limits.

    Args:
        fitness: of P plans, (P, poses, dof) -> (P,), smaller is better. lower, upper: finite limits, shape (dof,), rad
        or mm.
        rng: source of all randomness. bits: per joint variable, for the binary codings.
        violation: (P, poses, dof) -> (P,), at most 0 for a feasible plan; see `symcal.planning.constraints`.
        mixing: what crossover exchanges between two plans: single genes as in the paper, or whole poses, which are then
            as feasible in the child as they were in the parents.
        start: plans to begin with, shape (K, poses, dof); the rest of the population, if any, is random.
        callback: told of every generation.
    Raises:
        InputError: limits that are not finite or not ordered, an unknown coding, or numbers that make no population.
    Source: [Ding2017] section IV and Fig. 4; pymoo [Blank2020] runs it.
    """
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.problem import Problem
    from pymoo.problems.static import StaticProblem

    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    _check(
        lower,
        upper,
        coding,
        mixing,
        {"poses": poses, "bits": bits, "population": population, "generations": generations},
    )
    dof = lower.size
    binary, gray = coding != "real", coding == "gray"
    shape = (poses, dof, bits) if binary else (poses, dof)

    def plans(x: Any) -> Array:
        blocks = np.asarray(x).reshape(len(x), *shape)
        return decode(blocks, lower, upper, gray=gray) if binary else np.asarray(blocks, dtype=np.float64)

    first = lower + (upper - lower) * rng.random((population, poses, dof))
    if start is not None:
        first[: len(start)] = np.asarray(start, dtype=np.float64)[:population]
    genes = encode(first, lower, upper, bits, gray=gray) if binary else first
    problem = Problem(
        n_var=int(np.prod(shape)),
        n_obj=1,
        n_ieq_constr=0 if violation is None else 1,
        xl=None if binary else np.tile(lower, poses),
        xu=None if binary else np.tile(upper, poses),
        vtype=bool if binary else float,
    )
    algorithm = _algorithm(genes.reshape(population, -1), poses, binary, mixing)
    algorithm.setup(problem, termination=("n_gen", generations + 2), seed=int(rng.integers(2**31)), verbose=False)
    history, violations = np.empty(generations + 1), np.zeros(generations + 1)
    for generation in range(generations + 1):
        children = algorithm.ask()
        q = plans(children.get("X"))
        values = {"F": _finite(fitness(q))[:, None]}
        if violation is not None:
            values["G"] = _finite(violation(q))[:, None]
        Evaluator().eval(StaticProblem(problem, **values), children)
        algorithm.tell(infills=children)
        best = algorithm.pop[0]  # survival sorts by violation, then fitness
        history[generation], violations[generation] = best.F[0], max(best.CV[0], 0.0)
        if callback is not None:
            callback(generation, float(best.F[0]), plans(best.X[None])[0])
    return GeneticResult(
        poses=plans(algorithm.pop[0].X[None])[0],
        fitness=float(history[-1]),
        violation=float(violations[-1]),
        history=history,
        violations=violations,
        evaluations=population * (generations + 1),
        coding=coding,
    )


def _check(lower: Array, upper: Array, coding: str, mixing: str, counts: dict[str, int]) -> None:
    if coding not in get_args(Coding):
        raise InputError("unknown coding", key="coding", found=coding, allowed=get_args(Coding))
    if mixing not in get_args(Mixing):
        raise InputError("unknown kind of crossover", key="mixing", found=mixing, allowed=get_args(Mixing))
    if not (np.all(np.isfinite(lower)) and np.all(np.isfinite(upper)) and np.all(lower <= upper)):
        limits = ", ".join(f"[{a:g}, {b:g}]" for a, b in zip(lower, upper, strict=True))
        raise InputError(
            "the genetic algorithm needs finite, ordered limits for every joint", key="limits", found=limits
        )
    for name, low in (("poses", 1), ("bits", 1), ("population", 4), ("generations", 0)):
        if counts[name] < low:
            raise InputError(f"must be at least {low}", key=name, found=counts[name])
    if counts["bits"] > 52:
        raise InputError("more bits than a number has (52)", key="bits", found=counts["bits"])


def _finite(values: Array) -> Array:
    """A plan without a value (singular, nothing seen) is the worst there is, not an error."""
    return np.nan_to_num(np.asarray(values, dtype=np.float64), nan=1e300, posinf=1e300, neginf=-1e300)


def _algorithm(genes: Any, poses: int, binary: bool, mixing: Mixing) -> Any:
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.config import Config
    from pymoo.core.crossover import Crossover
    from pymoo.operators.crossover.sbx import SBX
    from pymoo.operators.crossover.ux import UniformCrossover
    from pymoo.operators.mutation.bitflip import BitflipMutation
    from pymoo.operators.mutation.pm import PM
    from pymoo.operators.selection.tournament import TournamentSelection
    from pymoo.util.misc import crossover_mask

    class PoseCrossover(Crossover):  # type: ignore[misc]
        """Exchange each pose of two plans with probability one half."""

        def __init__(self) -> None:
            super().__init__(2, 2)

        def _do(self, _: Any, x: Any, random_state: Any = None, **__: Any) -> Any:
            swap = random_state.random((x.shape[1], poses)) < 0.5
            return crossover_mask(x, np.repeat(swap, x.shape[2] // poses, axis=1))

    Config.warnings["not_compiled"] = False  # its notice goes to the terminal, which is not ours to write on
    by_gene = UniformCrossover() if binary else SBX()
    return GA(
        pop_size=len(genes),
        sampling=genes,
        selection=TournamentSelection(func_comp=_fitter),
        crossover=by_gene if mixing == "gene" else PoseCrossover(),
        mutation=BitflipMutation() if binary else PM(),
        eliminate_duplicates=False,  # costs more than everything else together
    )


def _fitter(pop: Any, pairs: NDArray[np.intp], **_: Any) -> NDArray[np.intp]:
    """Winners of binary tournaments, shape (n, 1): the smaller violation, then the smaller fitness."""
    fitness, violation = pop.get("F", "cv")
    rank = np.empty(len(fitness), dtype=np.intp)
    rank[np.lexsort([fitness[:, 0], violation])] = np.arange(len(fitness))
    return np.asarray(pairs[np.arange(len(pairs)), np.argmin(rank[pairs], axis=1)][:, None], dtype=np.intp)
