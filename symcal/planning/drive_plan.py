"""From a planning problem to poses in the order in which they are driven to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from symcal.config.plan import CoverageConfig, GeneticConfig, PlanConfig
from symcal.errors import RefusedError
from symcal.planning.area import draw
from symcal.planning.constraints import feasible
from symcal.planning.coverage import Coverage, coverage
from symcal.planning.criteria import criterion
from symcal.planning.fitness import PlanFunction, Reading, Weights, paper_fitness, sound_fitness
from symcal.planning.genetic_method import genetic_plan
from symcal.planning.methods import METHODS, Method, Report, SearchTask
from symcal.planning.ordering import shortest_tour, tour_of
from symcal.planning.path import Path as Motion
from symcal.planning.path import plan_path
from symcal.planning.plan_problem import PlanProblem
from symcal.planning.search import Plan, select_poses

Array = NDArray[np.float64]
Progress = Callable[[str], None]

DEFAULT_METHOD = "certified"

_ON_THE_WAY = 33  # poses at which the way between two is looked at, before the tour is chosen
_PER_CELL = 500  # poses of the area per cell of a coverage


@dataclass(frozen=True, slots=True)
class Planned:
    """A plan in driving order.

    names: of the poses, in that order. required: which of them the user insists on or coverage asks for, shape (N,).
    start: where the robot begins, shape (dof,). motion: the way, segment i leads to pose i. timed: its times are
    seconds; otherwise no speeds are known, the order is by shares of joint travel and times mean nothing.
    """

    plan: Plan
    names: tuple[str, ...]
    required: NDArray[np.bool_]
    start: Array
    motion: Motion
    timed: bool


def plan_generator(seed: int) -> np.random.Generator:
    """The randomness of a plan, apart from that of simulated data: the same seed plans the same in every command."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))


def find_plan(
    problem: PlanProblem, wanted: PlanConfig, rng: np.random.Generator, progress: Progress = lambda _: None
) -> Planned:
    """Choose the poses and put them in order.

    Raises:
        RefusedError: too few poses for what is identifiable, nothing feasible, or a coverage that cannot be had.
    """
    for_cells, for_search = rng.spawn(2)
    plan, required = covering_plan(problem, wanted, for_cells, for_search, progress)
    progress("ordering the poses")
    return in_order(problem, plan, required)


def search(
    problem: PlanProblem,
    wanted: PlanConfig,
    method: str,
    rng: np.random.Generator,
    *,
    required: Array | None = None,
    random: int = 0,
    prove: bool = False,
    progress: Progress = lambda _: None,
) -> Plan:
    """`select_poses` on a problem with one method.

    Args:
        required: instead of the problem's. random: plans to compare with.
        prove: the certificate's bounds, see `select_poses`.
    """
    name = wanted.criterion or ("D" if problem.candidates is None else "J")

    def told(seconds: float, value: float) -> None:
        progress(f"searching ({method}): {name} = {value:.6g} after {seconds:.1f} s")

    select = select_poses if wanted.unmodelled is None else partial(select_poses, unmodelled=wanted.unmodelled)
    return select(
        problem.info,
        wanted.poses,
        rng,
        method=method,
        methods=search_methods(problem, wanted.genetic),
        criterion=name,
        region=problem.region,
        aligned=problem.aligned,
        feasible=problem.feasible,
        required=problem.required if required is None else required,
        candidates=problem.choices,
        distance=wanted.distance,
        sample=wanted.sample,
        random=random,
        prove=prove,
        progress=told,
    )


def search_methods(problem: PlanProblem, wanted: GeneticConfig) -> Mapping[str, Method]:
    """All search methods, the genetic algorithm as the file wants it among them."""
    return METHODS | {"genetic": partial(_genetic, problem, wanted)}


def _genetic(
    problem: PlanProblem, wanted: GeneticConfig, task: SearchTask, rng: np.random.Generator, report: Report
) -> Array:
    return genetic_plan(
        task,
        rng,
        report,
        fitness=_fitness(problem, wanted),
        constraints=problem.measuring,
        coding=wanted.coding,
        bits=wanted.bits,
        population=wanted.population,
        generations=wanted.generations,
    ).poses


def _fitness(problem: PlanProblem, wanted: GeneticConfig) -> PlanFunction | None:
    """The fitness that the file names; None for the plan's own criterion."""
    info, view = problem.info, problem.view
    weights = Weights(wanted.weights.observability, wanted.weights.angle, wanted.weights.area)
    if wanted.fitness == "paper":
        if view is None:
            raise RefusedError(
                "the paper's fitness is about a camera and its target: give 'plan.constraints.camera', or take "
                "'plan.genetic.fitness: criterion'"
            )
        index = info.measurement.parameters.indices(info.names)
        columns = np.zeros((len(info.measurement.parameters), info.rank))
        columns[index] = info.scales[:, None] * info.basis
        # its Jacobian is of the robot's own parameters, which come first
        basis = columns[: len(view.chain.parameters)]
        return paper_fitness(view, basis, weights, Reading(conditioning=wanted.conditioning))
    if wanted.fitness == "condition":
        return sound_fitness(info, criterion("cond"), whitened=True, view=view, weights=weights)
    if weights.angle or weights.area:
        return sound_fitness(info, criterion("D"), view=view, weights=weights)
    return None


def covering_plan(
    problem: PlanProblem,
    wanted: PlanConfig,
    for_cells: np.random.Generator,
    for_search: np.random.Generator,
    progress: Progress,
) -> tuple[Plan, int]:
    """The plan, and how many of its first poses are required.

    Where cells of a coverage are missed, the most informative pose of each is required and the rest is searched again
    (ours): the search methods know points, not cells.
    """
    method = wanted.method or DEFAULT_METHOD
    cover = wanted.constraints.coverage
    must = problem.required
    cells = None if cover is None else _cells(problem, cover, wanted.poses, for_cells)
    streams = for_search.spawn(wanted.poses + 1)
    for stream in streams:
        plan = search(
            problem, wanted, method, stream, required=must, random=wanted.random, prove=wanted.prove, progress=progress
        )
        if cells is None or cover is None:
            return plan, len(must)
        made, sample = cells
        added = _missing(problem, made, sample, plan, cover.share)
        if not len(added):
            return plan, len(must)
        must = np.concatenate([must, added])
        if len(must) > wanted.poses:
            break
    raise RefusedError(
        f"{wanted.poses} poses cannot cover the cells beside the {len(problem.required)} required ones: ask for fewer "
        "cells, a smaller 'share', or more poses"
    )


def _cells(
    problem: PlanProblem, wanted: CoverageConfig, poses: int, rng: np.random.Generator
) -> tuple[Coverage, Array]:
    if problem.choices is not None:
        raise RefusedError(
            "coverage is not kept when choosing among candidates, a sample or postures that touch: "
            "leave out one of the two"
        )
    names = [joint.name for joint in problem.robot.joints]
    if wanted.joints is not None:
        unknown = [name for name in wanted.joints if name not in names]
        if unknown:
            raise RefusedError(f"coverage of joint '{unknown[0]}', which the robot lacks; it has {', '.join(names)}")
        index = [names.index(name) for name in wanted.joints]
        divisions = tuple(wanted.joints.values())
        coordinates: Callable[[Array], Array] = lambda q: q[:, index]  # noqa: E731
    else:
        divisions = tuple(wanted.position or ())
        coordinates = lambda q: problem.arm.motion(q)[0]  # noqa: E731
    sample = draw(problem.area, rng, _PER_CELL * int(np.prod(divisions)), problem.feasible)
    made = coverage(coordinates, sample, divisions, poses=poses if wanted.share == 1 else None)
    return made, sample


def _missing(problem: PlanProblem, cells: Coverage, sample: Array, plan: Plan, share: float) -> Array:
    """The most informative pose of every cell that the plan lacks, shape (k, dof)."""
    occupied = np.unique(cells.cell(plan.poses))
    missed = [cell for cell in cells.reachable if cell not in occupied]
    lacking = int(cells.violation(share)(plan.poses[None])[0])
    if not lacking:
        return np.zeros((0, problem.area.dof))
    where = cells.cell(sample)
    gain = problem.info.function.weighted(sample, np.asarray(np.linalg.inv(problem.info.total(plan.poses))))
    best = [int(np.argmax(np.where(where == cell, gain, -np.inf))) for cell in missed]
    foremost = sorted(best, key=lambda i: -gain[i])[:lacking]
    return sample[foremost]


def in_order(problem: PlanProblem, plan: Plan, required: int) -> Planned:
    """The poses of a plan along the shortest tour, and the way.

    Without a start the tour begins at the pose nearest to the middle of the working area.
    """
    robot, area = problem.robot, problem.area
    travel = np.where(np.isfinite(robot.upper - robot.lower), robot.upper - robot.lower, 2 * np.pi)
    speeds = travel if problem.speeds is None else problem.speeds
    start = problem.start
    if start is None:
        start = plan.poses[int(np.argmin(np.linalg.norm(area.unit(plan.poses) - 0.5, axis=1)))]
    order = shortest_tour(plan.poses, start, speeds, _blocked(problem, np.vstack([start, plan.poses]))).order
    poses = plan.poses[order]
    tour = tour_of(range(len(poses)), poses, start, speeds)
    motion = plan_path(problem.arm, poses, tour, start, speeds, (robot.lower, robot.upper), constraints=problem.moving)
    names: Sequence[str] = [str(i + 1) for i in range(len(order))]
    if plan.indices is not None and problem.candidates is not None:
        named = [*problem.required_names, *(problem.candidate_names[i] for i in plan.indices)]
        names = [named[i] for i in order]
    return Planned(
        plan=replace(plan, poses=poses),
        names=tuple(names),
        required=np.asarray(order < required),
        start=start,
        motion=motion,
        timed=problem.speeds is not None,
    )


def _blocked(problem: PlanProblem, nodes: Array) -> NDArray[np.bool_] | None:
    """Between which poses a joint motion would break what must hold on the way, shape (K, K); None if nothing must."""
    if not problem.moving:
        return None
    i, j = np.triu_indices(len(nodes), 1)
    share = np.linspace(0.0, 1.0, _ON_THE_WAY)[None, :, None]
    ways = nodes[i][:, None] + share * (nodes[j] - nodes[i])[:, None]
    clear = feasible(problem.moving)(ways.reshape(-1, nodes.shape[1])).reshape(len(i), -1).all(axis=1)
    out = np.zeros((len(nodes), len(nodes)), dtype=np.bool_)
    out[i, j] = out[j, i] = ~clear
    return out
