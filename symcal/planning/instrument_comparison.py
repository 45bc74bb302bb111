"""What each instrument brings: the same poses measured by one, by another, by several of them.

Every set of instruments is a measurement of its own, with its own unknown places. What it lets expect at the task
region is the posterior of an identification from the plan's poses, as for the plan itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.config.conversion import ExperimentFile
from symcal.documents.document import Document
from symcal.errors import InputError, RefusedError
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.planning.information import pose_information
from symcal.planning.nominal_noise import nominal_noise
from symcal.planning.plan_problem import PlanProblem
from symcal.planning.region import region_accuracy

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class InstrumentSet:
    """Some of the instruments at the poses of a plan.

    rank: seen directions out of ``parameters``. mean_mm, worst_mm: foretold rms error of the tool over the task region,
    and the largest at its sampled poses; None with the reason in ``refused``. aligned: after one rigid alignment,
    because these instruments do not say where the world is.
    """

    instruments: tuple[str, ...]
    rank: int = 0
    parameters: int = 0
    mean_mm: float | None = None
    worst_mm: float | None = None
    aligned: bool = False
    refused: str = ""


def compare_instruments(
    file: ExperimentFile, document: Document, model: Model, problem: PlanProblem, poses: Array
) -> tuple[InstrumentSet, ...]:
    """The sets that the plan names, else each instrument alone and all of them; nothing where there is one.

    Args:
        poses: of the plan, shape (N, dof).
    Raises:
        InputError: a set names an instrument that is not there.
    """
    entries = tuple(dict.fromkeys(o.of for o in model.task.observations))
    asked = [tuple(names) for names in file.plan.instruments]
    for i, names in enumerate(asked):
        for name in names:
            if name not in entries:
                raise document.error("no such instrument", ("plan", "instruments", i), found=name, allowed=entries)
    if not asked and len(entries) > 1:
        asked = [*((name,) for name in entries), entries]
    return tuple(_judged(file, model, problem, poses, names) for names in asked)


def _judged(
    file: ExperimentFile, model: Model, problem: PlanProblem, poses: Array, names: Sequence[str]
) -> InstrumentSet:
    task = only_instruments(model.task, names)
    try:
        own = build_model(model.robot, task)
        info = pose_information(
            own.measurement,
            own.setup,
            nominal_noise(file, own),
            (*own.kinematic, *own.placement),
            area=problem.area,
            feasible=problem.feasible,
            poses=len(poses),
            typical=problem.pool,
        )
    except (InputError, RefusedError) as error:
        return InstrumentSet(tuple(names), refused=getattr(error, "message", str(error)))
    aligned = own.measurement.adrift
    accuracy = region_accuracy(info, problem.region, aligned=aligned)
    posterior = info.posterior(poses)
    return InstrumentSet(
        tuple(names),
        info.rank,
        len(info.names),
        accuracy.mean_rms(posterior),
        float(accuracy.at(problem.region.poses, posterior).max()),
        aligned,
    )


def only_instruments(task: Task, names: Sequence[str]) -> Task:
    """The task without the other instruments, and without what is said of parameters that go with them."""
    own = replace(task.observed(o for o in task.observations if o.of in names), fix=(), scales={}, priors={})
    kept = {name for o in own.observations for name in o.names}
    gone = {name for o in task.observations for name in o.names} - kept
    return replace(
        own,
        fix=tuple(name for name in task.fix if name not in gone),
        scales={name: size for name, size in task.scales.items() if name not in gone},
        priors={name: size for name, size in task.priors.items() if name not in gone},
    )
