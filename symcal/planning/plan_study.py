"""Everything that is found out about a plan before anything is measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import one_thread
from symcal.config.conversion import ExperimentFile
from symcal.config.plan import PlanConfig
from symcal.documents.document import Document
from symcal.model.model import Model
from symcal.planning.accuracy_forecast.forecast import Forecast, PosesNeeded, forecast, ground, poses_needed
from symcal.planning.accuracy_forecast.random_band import RandomBand, random_band
from symcal.planning.area import draw
from symcal.planning.drive_plan import Planned, find_plan, plan_generator, search
from symcal.planning.instrument_comparison import InstrumentSet, compare_instruments
from symcal.planning.methods import fewest_poses
from symcal.planning.optimal_design import ApproximateDesign
from symcal.planning.plan_problem import PlanProblem, plan_problem
from symcal.planning.region import Accuracy, region_accuracy
from symcal.planning.search import Plan

Array = NDArray[np.float64]
Progress = Callable[[str], None]

_FIELD = 30000  # poses of the region for the map of predicted errors, and as many more with
_SNAPPED = 0.4  # of their coordinates at a limit
_COUNTS = 11  # numbers of poses that are foretold
_LARGEST = 2.5  # times the plan's own number


@dataclass(frozen=True, slots=True)
class ErrorField:
    """Predicted rms position error over the task region.

    tool: positions, shape (K, 3), and errors, shape (K,), mm, of poses dense at the limits too, where maxima are.
    uniform: errors of the poses that are uniform over the region, mm.
    """

    tool: Array
    errors: Array
    uniform: Array


@dataclass(frozen=True, slots=True)
class PlanStudy:
    """A plan and all that is known about it. methods: the plan's own first, then those it is compared with."""

    file: ExperimentFile
    problem: PlanProblem
    planned: Planned
    accuracy: Accuracy
    methods: Mapping[str, Plan]
    promise: Forecast | None
    band: RandomBand | None
    needed: tuple[PosesNeeded, ...]
    field: ErrorField
    instruments: tuple[InstrumentSet, ...] = ()


@one_thread()
def find(
    file: ExperimentFile, document: Document, model: Model, seed: int, progress: Progress = lambda _: None
) -> PlanStudy:
    """Search, certify, order, foretell.

    Raises:
        InputError, RefusedError: as `symcal.planning.plan_problem.plan_problem` and
        `symcal.planning.drive_plan.find_plan` do.
    """
    wanted = file.plan
    rng = plan_generator(seed)
    progress("preparing")
    problem = plan_problem(file, document, model, rng)
    planned = find_plan(problem, wanted, rng, progress)
    for_methods, for_promise, for_field = rng.spawn(3)
    accuracy = region_accuracy(problem.info, problem.region, aligned=problem.aligned)
    methods = {planned.plan.method: planned.plan}
    for name, stream in zip(wanted.compare, for_methods.spawn(len(wanted.compare)), strict=True):
        if name not in methods:
            methods[name] = search(problem, wanted, name, stream, progress=progress)
    foretold, band, needed = _promise(problem, accuracy, wanted, planned.plan.certificate.design, for_promise, progress)
    field = _field(problem, accuracy, planned, for_field)
    instruments = compare_instruments(file, document, model, problem, planned.plan.poses)
    return PlanStudy(file, problem, planned, accuracy, methods, foretold, band, needed, field, instruments)


def _promise(
    problem: PlanProblem,
    accuracy: Accuracy,
    wanted: PlanConfig,
    design: ApproximateDesign,
    rng: np.random.Generator,
    progress: Progress,
) -> tuple[Forecast | None, RandomBand | None, tuple[PosesNeeded, ...]]:
    """What fewer and more poses promise; nothing of a finite set."""
    if problem.choices is not None:
        return None, None, ()
    for_ground, for_counts, for_band, for_needed = rng.spawn(4)
    info, asked = problem.info, wanted.promise
    counts = sorted(set(asked.counts)) or _counts(fewest_poses(info), wanted.poses)
    objective = wanted.criterion if wanted.criterion not in (None, "J") else "D"
    progress("foretelling errors against the number of poses")
    known = ground(
        info, for_ground, region=problem.region, aligned=problem.aligned, feasible=problem.feasible, near=design
    )
    foretold = forecast(
        info,
        counts,
        for_counts,
        objective=str(objective),
        region=problem.region,
        feasible=problem.feasible,
        random=asked.random,
        known=known,
        progress=lambda count: progress(f"foretelling: {count} poses"),
    )
    foretold = _determined(foretold)
    band = random_band(info, accuracy, foretold.counts, max(asked.random, 100), for_band, feasible=problem.feasible)
    needed = []
    for millimetres, stream in zip(asked.accuracy, for_needed.spawn(len(asked.accuracy)), strict=True):
        progress(f"how many poses for {millimetres:g}?")
        needed.append(
            poses_needed(
                info,
                millimetres,
                stream,
                figure=asked.figure,
                feasible=problem.feasible,
                known=known,
            )
        )
    return foretold, band, tuple(needed)


def _determined(foretold: Forecast) -> Forecast:
    """Without numbers of poses that give enough equations and still leave a direction all but open."""
    far = 100 * np.array(foretold.bound_mean_mm)
    keep = [i for i, error in enumerate(foretold.best_mean_mm) if error < far[i]]

    def kept(values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(values[i] for i in keep)

    return Forecast(
        counts=tuple(foretold.counts[i] for i in keep),
        best_mean_mm=kept(foretold.best_mean_mm),
        best_worst_mm=kept(foretold.best_worst_mm),
        random_mean_mm=kept(foretold.random_mean_mm),
        random_worst_mm=kept(foretold.random_worst_mm),
        bound_mean_mm=kept(foretold.bound_mean_mm),
        bound_worst_mm=kept(foretold.bound_worst_mm),
        hidden_mm=foretold.hidden_mm,
    )


def _counts(fewest: int, poses: int) -> list[int]:
    """Numbers of poses from the fewest that can do to beyond the plan's, evenly in ratio, the plan's own among them."""
    most = max(round(_LARGEST * poses), fewest + 1)
    spread = np.geomspace(fewest, most, _COUNTS).round().astype(int)
    others = {int(n) for n in spread if abs(n - poses) > 0.1 * poses}
    return sorted({*others, max(poses, fewest)})


def _field(problem: PlanProblem, accuracy: Accuracy, planned: Planned, rng: np.random.Generator) -> ErrorField:
    region, total = problem.region, problem.info.posterior(planned.plan.poses)
    parts = [region.poses]
    if region.area is not None:
        parts += [draw(region.area, rng, _FIELD, region.feasible, share=share) for share in (0.0, _SNAPPED)]
    poses = np.concatenate(parts)
    return ErrorField(problem.arm.motion(poses)[0], accuracy.at(poses, total), accuracy.at(region.poses, total))
