"""Search methods for a plan, by name: each takes a task and returns poses.

random      poses uniform over the feasible set
exchange    greedy choice and exchange over a pool with coordinates snapped to limits
refine      gradient refinement of random plans, the best of several starts
combined    exchange, then refinement
certified   the same; `symcal.planning.search` then improves it with the certificate's design (`improve`)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.planning.area import Feasible, draw
from symcal.planning.bias_criterion import ExtendedRows
from symcal.planning.criteria import Criterion
from symcal.planning.exchange import Pool, exchange, pool_of
from symcal.planning.information import PoseInformation
from symcal.planning.optimal_design import ApproximateDesign
from symcal.planning.refine import refine
from symcal.planning.worst_pose import FeasibleSet

Array = NDArray[np.float64]
Report = Callable[[Array], None]
"""Told every plan on the way, shape (count, dof)."""

STARTS = 8  # random plans that the method `refine` starts from

ROUNDINGS = 2
"""Roundings of a design that `improve` tries."""

_NEAR = 5e-4  # of the score: a plan so near to the design can hardly be better
_PASSES, _WORTH = 3, 1e-4  # repetitions for the best, at most, as long as each raises the score by so much
_WEIGHTY = 1e-4  # weight from which on an atom of a design is worth trying
_NEIGHBOURS = 24  # feasible neighbours of each pose in a local exchange
_FORETOLD, _FEWEST = 480, 4  # neighbours of all poses together, and of each at least, of a plan that is only foretold
_RADII = (0.1, 0.03, 0.01)  # of the working area
_GAIN = 1e-6  # of the score: less is not worth another round


@dataclass(frozen=True, slots=True)
class SearchTask:
    """What is to be planned.

    count: poses to find, beyond those that are required. fixed: information of priors and required poses, shape (n, n).
    where: the feasible set with a dense sample; a finite one (area None) are candidates, each to be taken once.
    required: shape (k, dof). distance: smallest distance between any two poses, in units of the working area.
    extended: rows that the criterion works on instead of the information's own; ``fixed`` is then of their size.
    """

    info: PoseInformation
    criterion: Criterion
    count: int
    fixed: Array
    where: FeasibleSet
    required: Array
    distance: float = 0.0
    extended: ExtendedRows | None = None

    def rows(self, poses: Array) -> Array:
        """What the criterion's matrix is made of, shape (N, m, e)."""
        return self.info.rows(poses) if self.extended is None else self.extended.rows(poses)

    @property
    def feasible(self) -> Feasible | None:
        return self.where.feasible

    @property
    def finite(self) -> bool:
        return self.where.area is None

    @property
    def keep_off(self) -> Array:
        return self.info.area.unit(self.required)

    def score(self, poses: Array) -> float:
        return float(self.criterion.score(self.total(poses)))

    def total(self, poses: Array) -> Array:
        """The criterion's matrix for required poses, priors and these, shape (e, e)."""
        rows = self.rows(poses)
        rows = rows.reshape(-1, rows.shape[2])
        return np.asarray(self.fixed + rows.T @ rows)

    def pool(self, poses: Array) -> Pool:
        """Poses as a pool; those without finite information are left out."""
        rows = self.rows(poses)
        usable = np.isfinite(rows).all(axis=(1, 2))
        return pool_of(poses[usable], rows[usable], self.info.area.unit(poses[usable]))


def fewest_poses(info: PoseInformation) -> int:
    """Poses that give as many numbers as there are directions which priors leave open."""
    open_ = info.rank - int(np.linalg.matrix_rank(info.prior))
    return max(-(-open_ // info.components), 1)


Method = Callable[[SearchTask, np.random.Generator, Report], Array]


def random_plan(task: SearchTask, rng: np.random.Generator, report: Report) -> Array:
    """Uniform over the feasible set; with a distance, those that come too near to an earlier one are passed over."""
    if task.distance == 0:
        poses = _random(task, rng, task.count)
        report(poses)
        return poses
    tries = _random(task, rng, len(task.where.sample) if task.finite else 50 * task.count)
    taken = list(task.keep_off)
    kept: list[Array] = []
    for pose, unit in zip(tries, task.info.area.unit(tries), strict=True):
        if len(kept) < task.count and all(np.linalg.norm(unit - other) >= task.distance for other in taken):
            kept.append(pose)
            taken.append(unit)
    if len(kept) < task.count:
        raise RefusedError(f"only {len(kept)} of {task.count} poses found at a distance of {task.distance:g}")
    report(np.array(kept))
    return np.array(kept)


def _random(task: SearchTask, rng: np.random.Generator, count: int) -> Array:
    if task.where.area is None:
        if count > len(task.where.sample):
            raise RefusedError(f"{count} poses are wanted, and there are {len(task.where.sample)} to choose from")
        return task.where.sample[rng.permutation(len(task.where.sample))[:count]]
    return draw(task.where.area, rng, count, task.feasible)


def exchange_plan(task: SearchTask, rng: np.random.Generator, report: Report) -> Array:
    """Exchange over the feasible set's sample."""
    del rng  # the sample is the only randomness
    return _exchange(task, task.pool(task.where.sample), None, report)


def refine_plan(task: SearchTask, rng: np.random.Generator, report: Report) -> Array:
    """The best of several random plans, each refined by its gradient."""
    if task.finite:
        raise RefusedError(
            "the poses to choose from are a finite set: 'refine' has nothing to move; use 'exchange' or 'certified'"
        )
    plans = [_refine(task, random_plan(task, rng, report), report) for _ in range(STARTS)]
    return max(plans, key=task.score)


def combined_plan(task: SearchTask, rng: np.random.Generator, report: Report) -> Array:
    """Exchange over the sample, then refinement (none for candidates)."""
    best = _exchange(task, task.pool(task.where.sample), None, report)
    return best if task.finite else _polish(task, best, rng, report)


def improve(
    task: SearchTask, poses: Array, design: ApproximateDesign, rng: np.random.Generator, report: Report
) -> Array:
    """The best of several exchanges and refinements with the poses of an optimal approximate design to choose from; the
    first begins at the plan, the others at roundings of the design. Never worse than the plan; at once done where the
    plan is as near to the design as a rounding can be."""
    if task.finite:
        return poses
    goal = np.inf
    if task.extended is None:
        goal = float(task.criterion.score((task.count + len(task.required)) * design.matrix)) - _NEAR
    weighty = design.weights > _WEIGHTY
    atoms = design.poses[weighty]
    # with a distance between poses the design, which knows of none, is no plan to begin with
    roundings = ROUNDINGS if task.distance == 0 else 0

    def again(start: Array) -> Array:
        pool = task.pool(np.concatenate([start, atoms]))
        if len(pool) < len(start) + len(atoms):
            return start  # some pose tells nothing: places in the pool would be wrong
        return _polish(task, _exchange(task, pool, len(start), report, repeats=True), rng, report)

    best = poses
    for turn in range(1 + roundings):
        if task.score(best) >= goal:
            return best
        tried = again(poses if turn == 0 else rounded(atoms, design.weights[weighty], task.count, rng))
        best = tried if task.score(tried) > task.score(best) else best
    for _ in range(_PASSES):
        tried = again(best)
        gain = task.score(tried) - task.score(best)
        best = tried if gain > 0 else best
        if not gain > _WORTH or task.score(best) >= goal:
            break
    return best


def plan_of(task: SearchTask, design: ApproximateDesign, rng: np.random.Generator) -> Array | None:
    """A design as a plan, for so many poses that rounding costs next to nothing; None where it does."""
    plan = rounded(design.poses, design.weights, task.count, rng)
    best = float(task.criterion.score(task.fixed + task.count * design.matrix))
    if task.score(plan) < best - _NEAR:
        plan = _refine(task, plan, lambda _: None)
    return plan if task.score(plan) >= best - _NEAR else None


def plan_from(task: SearchTask, design: ApproximateDesign, rng: np.random.Generator) -> Array:
    """Exchange over the poses of a design instead of a dense sample, then refinement: as good, and much less to look
    at."""
    pool = task.pool(design.poses[design.weights > _WEIGHTY])
    poses = _exchange(task, pool, None, lambda _: None, repeats=True)
    neighbours = min(max(_FORETOLD // len(poses), _FEWEST), _NEIGHBOURS)
    return _polish(task, poses, rng, lambda _: None, neighbours)


def rounded(atoms: Array, weights: Array, count: int, rng: np.random.Generator) -> Array:
    """A design as so many poses, shape (count, dof): each atom as often as its share of the weight says, to the whole
    number below or above, by systematic sampling in random order ([Madow1949])."""
    order = rng.permutation(len(weights))
    ends = np.cumsum(weights[order])
    taken = np.searchsorted(ends, (rng.random() + np.arange(count)) / count * ends[-1], side="right")
    return np.asarray(atoms[order[np.minimum(taken, len(order) - 1)]])


def _exchange(task: SearchTask, pool: Pool, keep: int | None, report: Report, *, repeats: bool = False) -> Array:
    """Exchange over a pool, from its first ``keep`` poses as the plan, or from a greedy one."""
    start = None if keep is None else np.arange(keep)
    chosen = exchange(
        pool,
        task.criterion,
        task.count,
        task.fixed,
        start=start,
        repeats=repeats,
        distance=task.distance,
        keep_off=task.keep_off,
        progress=lambda index, _: report(pool.poses[index]),
    )
    return pool.poses[chosen]


def _refine(task: SearchTask, poses: Array, report: Report) -> Array:
    if task.extended is not None:
        return poses  # no derivatives of those: neighbours are exchanged instead
    return refine(
        task.info,
        task.criterion,
        poses,
        task.fixed,
        feasible=task.feasible,
        distance=task.distance,
        keep_off=task.keep_off,
        progress=lambda at, _: report(at),
    )


def _polish(
    task: SearchTask, poses: Array, rng: np.random.Generator, report: Report, neighbours: int = _NEIGHBOURS
) -> Array:
    """Gradient refinement; where constraints or kinks stop it, exchange among feasible neighbours of the poses."""
    free = task.feasible is None and task.distance == 0
    poses = _refine(task, poses, (lambda _: None) if not free else report)
    report(poses)
    if free and task.criterion.smooth and task.extended is None:
        return poses
    for radius in _RADII:
        before = task.score(poses)
        area = task.info.area
        step = rng.normal(size=(neighbours, *poses.shape)) * radius * area.span
        near = area.clip(poses + step).reshape(-1, area.dof)
        if task.feasible is not None:
            near = near[task.feasible(near)]
        poses = _exchange(task, task.pool(np.concatenate([poses, near])), len(poses), report, repeats=True)
        if task.score(poses) < before + _GAIN:
            continue
        poses = _refine(task, poses, lambda _: None)
        report(poses)
    return poses


METHODS: dict[str, Method] = {
    "certified": combined_plan,
    "combined": combined_plan,
    "exchange": exchange_plan,
    "refine": refine_plan,
    "random": random_plan,
}
"""Search methods by name; others may be added."""
