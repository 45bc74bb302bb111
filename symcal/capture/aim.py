"""What a capture works towards: a plan's poses, the region where accuracy matters, and how accurate it shall be there.

Everything is that of `symcal plan`: the same region, the same constraints, the same expression of the arm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.candidates import candidates
from symcal.calibration.extend import planned_model, with_terms
from symcal.config import conversion as config
from symcal.data.dataset import evenly
from symcal.errors import InputError
from symcal.fit.options import Options
from symcal.instruments import Instrument
from symcal.joints.backlash import direction_name
from symcal.model.model import Model
from symcal.model.observation import Observation
from symcal.planning.area import draw
from symcal.planning.drive_plan import plan_generator
from symcal.planning.nominal_noise import nominal_noise
from symcal.planning.plan_file import read_plan
from symcal.planning.plan_problem import PlanProblem, plan_problem
from symcal.robot.robot import Robot
from symcal.runs.load import Experiment, load

Array = NDArray[np.float64]

PLAN = "plan.csv"
EXPERIMENT = "experiment.resolved.yaml"
_BACKLASH = "backlash"
_POOL = 400  # poses beyond the plan's that may be named when these are used up
_REGION = 500  # poses of the region
_SNAPPED = 0.4  # of their coordinates at a limit, where poses tell most


@dataclass(frozen=True, slots=True)
class Aim:
    """What does not change during a capture; made by `aim_of`.

    model: with every joint term that the identification may keep. options: of its fits. nominal: the noise that the
    plan was made with, by group. region: poses that stand for the region, shape (K, dof). names, poses: of the plan,
    then further ones of the region, (P,) and (P, dof); planned: how many are the plan's. rows: what each of them tells
    at nominal, whitened by `nominal`, shape (P, m, p). tolerance: rms error over the region, mm; None where nothing is
    said. directed: joints come from alternating sides.
    """

    experiment: Experiment
    plan: Path
    model: Model
    options: Options
    nominal: Mapping[str, float]
    problem: PlanProblem
    region: Array
    names: tuple[str, ...]
    poses: Array
    planned: int
    rows: Array
    tolerance: float | None
    directed: bool

    @property
    def observation(self) -> Observation:
        """What reads what."""
        (only,) = self.model.task.observations
        return only

    @property
    def instrument(self) -> Instrument:
        return self.observation.instrument

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the p free parameters."""
        return self.problem.info.names

    @property
    def scales(self) -> Array:
        """Their plausible sizes, shape (p,)."""
        return self.problem.info.scales

    def number(self, pose: str) -> int:
        """Which of the poses is called so."""
        return self.names.index(pose)

    def directions(self, number: int) -> Array:
        """From where joints should come to the reading of a number, shape (dof,): drawn once and for all, so that the
        sides are as many for every joint and no two joints go together."""
        dof = self.model.robot.dof
        if not self.directed:
            return np.zeros(dof)
        pair = np.random.default_rng([dof, (number - 1) // 2]).choice([-1.0, 1.0], dof)
        return pair if number % 2 else -pair


def aim_of(plan: Path, tolerance: float | None = None) -> Aim:
    """Read a plan with its experiment.

    Args:
        plan: the folder that `symcal plan` wrote, or the plan.csv in it. tolerance: mm, instead of the experiment's.
    Raises:
        InputError: a file that is not there or not as it should be, or an experiment that cannot be captured.
        RefusedError: as of `symcal.planning.plan_problem.plan_problem`.
    """
    path = plan / PLAN if plan.is_dir() else plan
    file = path.with_name(EXPERIMENT)
    for each in (path, file):
        if not each.is_file():
            raise InputError("there is no such file: name the folder that 'symcal plan' wrote", file=each)
    experiment = load(file)
    observations = experiment.model.task.observations
    if len(observations) > 1:
        several = ", ".join(o.name for o in observations)
        raise InputError("capture leads one instrument at a time; here measure", file=file, found=several)
    if observations[0].instrument.constrains:
        raise InputError("a constraint reads nothing: write its joint readings down yourself", file=file)
    groups, directed = experiment.file.identification.groups, _asks_for_directions(experiment)
    model = planned_model(experiment.model, groups)
    if directed and _BACKLASH in groups:
        model = with_terms(model, candidates(model.robot, (_BACKLASH,), _directions(experiment.robot)))
    shrinking = tuple(dict.fromkeys(p.group for p in model.robot.term_parameters.values()))
    loss = "linear" if experiment.options.loss == "auto" else experiment.options.loss
    options = replace(experiment.options, loss=loss, shrinking=shrinking if groups else ())
    rng = plan_generator(experiment.seed)
    problem = plan_problem(experiment.file, experiment.document, model, rng)
    poses, names = read_plan(path, experiment.robot)
    more = problem.choices if problem.choices is not None else _drawn(problem)
    every = np.vstack([poses, more])
    said = config.tolerance_of(experiment.file)
    wanted = tolerance if tolerance is not None or said is None else said.position
    return Aim(
        experiment=experiment,
        plan=path,
        model=model,
        options=options,
        nominal=nominal_noise(experiment.file, model),
        problem=problem,
        region=problem.region.poses[evenly(len(problem.region.poses), _REGION)],
        names=(*names, *(f"more{i + 1}" for i in range(len(more)))),
        poses=every,
        planned=len(poses),
        rows=problem.info.function.full(every),
        tolerance=wanted,
        directed=directed,
    )


def _drawn(problem: PlanProblem) -> Array:
    return draw(problem.area, np.random.default_rng(0), _POOL, problem.feasible, share=_SNAPPED)


def _asks_for_directions(experiment: Experiment) -> bool:
    """Whether backlash is in the robot file, or asked for by name."""
    groups = experiment.file.identification.groups
    return _BACKLASH in groups or not set(_directions(experiment.robot)).isdisjoint(experiment.robot.conditions)


def _directions(robot: Robot) -> tuple[str, ...]:
    return tuple(direction_name(i) for i in range(1, robot.dof + 1))
