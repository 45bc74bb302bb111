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
Codes = NDArray[np.unsignedinteger[Any]]
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


def decode(codes: Codes, lower: Array, upper: Array, bits: int, *, gray: bool = False) -> Array:
    """Joint values of codes: lower + (upper - lower) k / (2^bits - 1), so that both limits are reached exactly.

    Args:
        codes: whole numbers below 2^bits, shape (..., dof). lower, upper: shape (dof,).
        gray: the code in which neighbouring values differ in one bit.
    Returns:
        shape (..., dof), rad or mm.
    """
    k = codes
    if gray:  # k_i is the parity of the bits from i on
        shift = 1
        while shift < bits:
            k = k ^ (k >> k.dtype.type(shift))
            shift *= 2
    share = k / (2.0**bits - 1)
    return np.asarray(np.where(share == 1.0, upper, lower + (upper - lower) * share))


def encode(values: Array, lower: Array, upper: Array, bits: int, *, gray: bool = False) -> Codes:
    """The codes, shape (..., dof), whose values are nearest to the given ones, in as few bytes as ``bits`` need."""
    width = np.where(upper > lower, upper - lower, 1.0)
    k = np.rint((values - lower) / width * (2**bits - 1)).astype(np.int64)
    k = np.clip(k, 0, 2**bits - 1)
    if gray:
        k = k ^ (k >> 1)
    return np.asarray(k.astype(np.min_scalar_type(2**bits - 1)))


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
    from symcal.planning.columns_ga import columns_ga  # pymoo takes a second to load

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

    def plans(genes: Any) -> Array:
        blocks = genes.reshape(len(genes), poses, dof)
        return decode(blocks, lower, upper, bits, gray=gray) if binary else np.asarray(blocks)

    first = lower + (upper - lower) * rng.random((population, poses, dof))
    if start is not None:
        first[: len(start)] = np.asarray(start, dtype=np.float64)[:population]
    genes: Any = encode(first, lower, upper, bits, gray=gray) if binary else first
    algorithm = columns_ga(
        genes.reshape(population, -1),
        poses,
        bits if binary else None,
        mixing,
        (lower, upper),
        generations,
        int(rng.integers(2**31)),
    )
    history, violations = np.empty(generations + 1), np.zeros(generations + 1)
    for generation in range(generations + 1):
        children = algorithm.ask()
        q = plans(children.genes)
        children.fitness = _finite(fitness(q))
        if violation is not None:
            children.violation = np.maximum(_finite(violation(q)), 0.0)
        algorithm.tell(infills=children)
        best = algorithm.pop[:1]  # survival sorts by violation, then fitness
        history[generation], violations[generation] = best.fitness[0], best.violation[0]
        if callback is not None:
            callback(generation, float(best.fitness[0]), plans(best.genes)[0])
    return GeneticResult(
        poses=plans(algorithm.pop.genes[:1])[0],
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
