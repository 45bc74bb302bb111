"""The genetic algorithm as a search method beside the others (`symcal.planning.methods`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.planning.area import Feasible, WorkingArea, draw
from symcal.planning.constraints import Constraint, plan_violation, with_fixed
from symcal.planning.coverage import nearest_distance
from symcal.planning.fitness import PlanFunction, sound_fitness
from symcal.planning.genetic import Coding, GeneticResult, Mixing, decode, encode, genetic
from symcal.planning.methods import SearchTask

Array = NDArray[np.float64]
Report = Callable[[Array], None]

_POOL = 4000  # feasible poses from which the first plans are put together


def genetic_plan(
    task: SearchTask,
    rng: np.random.Generator,
    report: Report,
    *,
    fitness: PlanFunction | None = None,
    constraints: Sequence[Constraint] = (),
    coding: Coding = "binary",
    bits: int = 8,
    population: int = 200,
    generations: int = 200,
) -> GeneticResult:
    """Run the genetic algorithm on a planning task; its result holds the free poses, without the required ones.

    With constraints, the first plans are made of feasible poses and crossover exchanges whole poses: one that mixes the
    genes of two poses hardly ever gives a feasible third.

    Args:
        fitness: of complete plans, required poses first; minus the task's criterion when None (`sound_fitness`).
        constraints: those behind the task's ``feasible``; they tell how far a pose is from being feasible, which the
            mask does not.
    Raises:
        RefusedError: candidates are a finite set, or no feasible plan was found.
    """
    if task.where.area is None:
        raise RefusedError(
            "the poses to choose from are a finite set: 'genetic' has nothing to vary; use 'exchange' or 'certified'"
        )
    area, mask = task.where.area, task.feasible
    if fitness is None:
        objective = sound_fitness(task.info, task.criterion, fixed=task.fixed)
    else:
        objective = with_fixed(fitness, task.required) if len(task.required) else fitness
    free = mask is None and task.distance == 0
    mixing: Mixing = "gene" if mask is None else "pose"
    start = None if mask is None else _first_plans(area, mask, task.count, population, coding, bits, rng)
    result = genetic(
        objective,
        area.lower,
        area.upper,
        task.count,
        rng,
        coding=coding,
        mixing=mixing,
        bits=bits,
        population=population,
        generations=generations,
        violation=None if free else _violation(task, mask, constraints),
        start=start,
        callback=lambda _, __, poses: report(poses),
    )
    if result.violation > 0:
        message = f"after {generations} generations the best plan still breaks constraints"
        raise RefusedError(f"{message}: give it more generations, or use the method 'certified'")
    return result


def _violation(task: SearchTask, mask: Feasible | None, constraints: Sequence[Constraint]) -> PlanFunction:
    amount = plan_violation(constraints)

    def violation(plans: Array) -> Array:
        total = amount(plans)
        if mask is not None:
            wrong = ~mask(plans.reshape(-1, plans.shape[-1]))
            total = total + wrong.reshape(plans.shape[:2]).sum(axis=1)
        if task.distance > 0:
            fixed = np.broadcast_to(task.required, (len(plans), *task.required.shape))
            near = nearest_distance(np.concatenate([fixed, plans], axis=1), task.info.area)
            total = total + np.maximum(1.0 - near / task.distance, 0.0).sum(axis=1)
        return np.asarray(total)

    return violation


def _first_plans(
    area: WorkingArea, mask: Feasible, count: int, population: int, coding: Coding, bits: int, rng: np.random.Generator
) -> Array:
    """Plans of feasible poses, shape (population, count, dof), that stay feasible when they are coded."""

    def coded(poses: Array) -> Array:
        if coding == "real":
            return poses
        gray = coding == "gray"
        return decode(encode(poses, area.lower, area.upper, bits, gray=gray), area.lower, area.upper, bits, gray=gray)

    pool = coded(draw(area, rng, _POOL, mask))
    pool = pool[mask(pool)]
    if not len(pool):
        raise RefusedError(f"no feasible pose is left when joint values are coded in {bits} bits: use more")
    return np.asarray(pool[rng.integers(len(pool), size=(population, count))])
