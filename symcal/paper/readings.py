"""The paper's fitness, eq. 12, in the several ways it can be read, each with the plan that it leads to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from symcal.config.study import SearchConfig
from symcal.outputs.side_by_side import side_by_side
from symcal.paper.results import RandomPlanErrors, ReadingResult, Setting, StudyPlan
from symcal.planning.certificate import Certificate
from symcal.planning.criteria import criterion
from symcal.planning.fitness import PlanFunction, Reading, Weights, paper_fitness, sound_fitness
from symcal.planning.genetic_method import genetic_plan
from symcal.planning.methods import SearchTask

Array = NDArray[np.float64]

_ROWS = {
    "image": "rows M11 J / z of the image, as printed",
    "projection": "rows of the exact derivative of the image",
    "position": "rows J / z of the position, without the camera",
}
_CONDITIONING = {
    "per_pose": "one condition number per pose",
    "stacked": "one condition number of all poses together",
}


@dataclass(frozen=True, slots=True)
class _Way:
    """One way to read the fitness: a `Reading` with its columns scaled or not, or (None) the whitened one."""

    key: str
    reading: Reading | None
    scaled: bool = True

    @property
    def text(self) -> str:
        if self.reading is None:
            return "one condition number of all poses together, relative to the mean information of the working area"
        columns = "columns per plausible error" if self.scaled else "columns per rad and mm"
        return f"{_CONDITIONING[self.reading.conditioning]}, {_ROWS[self.reading.rows]}, {columns}"


def main_fitness(setting: Setting, weights: Weights, reading: Reading) -> PlanFunction:
    """The paper's fitness as the config reads it: the one behind the plan `paper_ga`."""
    return _fitness(setting, weights, _Way("main", reading))


def _fitness(setting: Setting, weights: Weights, way: _Way) -> PlanFunction:
    info = setting.info
    if way.reading is None:
        return sound_fitness(info, criterion("cond"), whitened=True, view=setting.view, weights=weights)
    basis = info.scales[:, None] * info.basis
    if not way.scaled:
        # an orthonormal basis, in rad and mm, of the same row space: what J sees is span(S^-1 V_1)
        basis = np.linalg.qr(info.basis / info.scales[:, None])[0]
    return paper_fitness(setting.view, basis, weights, way.reading)


def _ways(main: Reading) -> tuple[_Way, ...]:
    """The reading of the config first, then others that change one thing about it."""
    others = [
        _Way("per_pose", replace(main, conditioning="per_pose")),
        _Way("stacked", replace(main, conditioning="stacked")),
        _Way("without_camera", replace(main, rows="position")),
        _Way("unscaled", main, scaled=False),
        _Way("whitened", None),
    ]
    return (_Way("main", main), *(way for way in others if way.reading != main or not way.scaled))


def readings(
    setting: Setting,
    plans: Mapping[str, StudyPlan],
    random: RandomPlanErrors,
    weights: Weights,
    main: Reading,
    search: SearchConfig,
    proof: Certificate,
    rng: np.random.Generator,
) -> tuple[ReadingResult, ...]:
    """Search a plan by every reading, and judge it by what it predicts for the test poses.

    Args:
        plans: those of the study; `paper_ga` is the main reading's. proof: a certificate of the same feasible set, for
            the bound of the D-efficiency.
    """
    ways = _ways(main)
    fitnesses = [_fitness(setting, weights, way) for way in ways]
    known = plans["paper_ga"].poses, plans["paper_ga"].history

    def searched(k: int, own: np.random.Generator) -> tuple[Array, Array]:
        if ways[k].key == "main" and known[1] is not None:
            return known[0], known[1]
        return evolve(setting, fitnesses[k], search, search.side_generations, own)

    results = side_by_side([partial(searched, k, own) for k, own in enumerate(rng.spawn(len(ways)))])
    found = []
    for way, fitness, (poses, history) in zip(ways, fitnesses, results, strict=True):
        total = setting.info.total(poses)
        matrix = total / len(poses)
        expected = setting.accuracy.mean_rms(setting.info.posterior(poses))
        logdet = float(np.linalg.slogdet(matrix)[1])
        found.append(
            ReadingResult(
                key=way.key,
                text=way.text,
                reading=way.reading,
                main=way.key == "main",
                poses=poses,
                history=history,
                expected_rms_mm=expected,
                d_efficiency_lower_bound=float(np.exp((logdet - proof.logdet_upper_bound) / setting.info.rank)),
                beats_random=random.beaten_by(expected),
                distinct=_distinct(setting, poses),
                scores={name: float(fitness(plan.poses[None])[0]) for name, plan in plans.items()},
            )
        )
    return tuple(found)


def evolve(
    setting: Setting,
    fitness: PlanFunction,
    search: SearchConfig,
    generations: int,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """The genetic algorithm with a fitness: the best plan, shape (N, dof), and its history."""
    info = setting.info
    task = SearchTask(info, criterion("D"), setting.count, info.prior, setting.where, np.zeros((0, info.area.dof)))
    result = genetic_plan(
        task,
        rng,
        lambda _: None,
        fitness=fitness,
        coding=search.coding,
        bits=search.bits,
        population=search.population,
        generations=generations,
    )
    return result.poses, result.history


def _distinct(setting: Setting, poses: Array) -> int:
    """Poses that are further than a hundredth of the working area from every earlier one that counts."""
    kept: list[Array] = []
    for pose in setting.info.area.unit(poses):
        if all(np.abs(pose - other).max() > 0.01 for other in kept):
            kept.append(pose)
    return len(kept)
