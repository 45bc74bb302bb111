"""An identification: an experiment in, what was found out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration import results
from symcal.calibration.calibrate import Calibration, baseline_model
from symcal.calibration.claims import extrapolation, optimism, worse
from symcal.calibration.compare import compare, cross_validate
from symcal.calibration.evaluate import Errors, evaluate_each, expected_position_rms, judging
from symcal.calibration.extend import calibrate_extended, planned_model, shrinking, with_directions
from symcal.calibration.extension_facts import extension_facts
from symcal.calibration.halves import Halves
from symcal.calibration.model_check import ModelCheck
from symcal.calibration.remainder import refined, remainder_facts, with_remainder
from symcal.calibration.thinned import few_folds, listed_notes, thinned_notes
from symcal.config import conversion as config
from symcal.config.conversion import ExperimentFile, RenderedData, SimulatedData
from symcal.data.dataset import Dataset, unseen
from symcal.errors import InputError, RefusedError
from symcal.export.results import correction_facts
from symcal.planning.forecast_check import forecast_check
from symcal.robot.robot import Robot
from symcal.runs.check import parallel_axes
from symcal.runs.data import measurements
from symcal.runs.judged import area_of, decided, judge_test_poses, with_check, with_halves
from symcal.runs.load import Experiment

if TYPE_CHECKING:
    from symcal.calibration.compensation_check import Handover
    from symcal.images.entries import EntryImages
    from symcal.images.rendered_boards import RenderedBoards
    from symcal.images.run import ImageRun
    from symcal.planning.drive_plan import Planned

Array = NDArray[np.float64]
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What an identification run found.

    planned: the plan behind simulated data, if they have one. handover: what compensation achieves, where the truth is
        known. images: of a simulated measurement with a camera; its errors are against the truth. measured_in: what
        was measured in images that were given, or rendered of a board: the truth of these is in rendered. check: of the
        model by the training data. halves: of these, identified apart, where they can be.
    """

    experiment: Experiment
    data: Dataset
    planned: Planned | None
    inputs: tuple[Path, ...]
    calibration: Calibration
    errors: Mapping[str, Mapping[str, Errors]]
    handover: Handover | None
    content: Mapping[str, Any]
    check: ModelCheck | None = None
    halves: Halves | None = None
    images: ImageRun | None = None
    measured_in: tuple[EntryImages, ...] = ()
    rendered: RenderedBoards | None = None


def identify_experiment(experiment: Experiment, *, data: Path | None = None, progress: Progress) -> Outcome:
    """Measure (or read), identify, evaluate."""
    simulated = isinstance(experiment.file.data, SimulatedData | RenderedData)
    if experiment.model.task.scene is not None and simulated and data is None:
        return _with_images(experiment, progress)
    rng = np.random.default_rng(experiment.seed)
    planned = None if data else plan_of(experiment, progress)
    progress("reading the measurements" if config.reads_files(experiment.file) or data else "simulating")
    own = (experiment.file, experiment.document, experiment.model)
    found = measurements(*own, rng, data=data, planned=planned, progress=progress)
    if found.rendered is not None:
        experiment = replace(experiment, model=found.rendered.model)
    measured, exact = found.data, found.exact
    measured = with_directions(measured, experiment.robot, experiment.file.identification.groups)
    progress("identifying")
    calibration = _calibrated(experiment, measured)
    experiment = replace(experiment, model=calibration.model, options=shrinking(calibration, experiment.options))
    if experiment.file.identification.remainder == "smooth":
        progress("looking for a smooth remainder")
        calibration = with_remainder(calibration, measured, experiment.options, rng.spawn(1)[0])
    splits: list[str] = [split for split in ("train", "test") if split in measured.split]
    by_instrument = {
        split: {name: evaluate_each(state, measured.part(split)) for name, state in calibration.states.items()}
        for split in splits
    }
    errors: dict[str, Mapping[str, Errors]] = {}
    notes: list[str] = []
    for split, states in by_instrument.items():
        try:
            errors[split] = {name: judging(experiment.model.task, each) for name, each in states.items()}
        except RefusedError as error:
            notes.append(f"the {split} poses do not judge: {error}")
    if exact is not None:
        errors["truth"] = compare(calibration, exact)
    count = experiment.file.validation.folds
    if count is None:
        count = 0 if "test" in measured.split else 5
    told = [each.text for each in calibration.mistakes]
    said = [note for note in calibration.notes if note not in told]
    notes = [*told, *notes, *_spelling(experiment.file), *measured.notes, *parallel_axes(experiment.robot), *said]
    if count:
        progress(f"cross-validating in {count} folds")
        used = measured.used
        notes += few_folds(used)
        try:
            refine = refined(calibration, experiment.options)
            errors["cross_validation"] = cross_validate(
                experiment.model, used.few(), experiment.options, count, rng, refine, near=calibration
            )
        except RefusedError as error:
            notes.append(f"cross-validation was not possible: {error}")
    notes += [*extrapolation(measured), *optimism(errors), *thinned_notes(measured), *listed_notes(measured)]
    handover = None if found.truth is None else _handover(experiment, calibration, found.truth, rng)
    inputs = (experiment.document.path, experiment.robot_path, *found.inputs)
    instruments = results.instrument_facts(experiment.model.task, by_instrument)
    notes += worse(instruments)
    labels = {split: measured.part(split).labels for split in splits}
    labels["cross_validation"] = measured.used.few().labels
    content = _content(experiment, measured, inputs, calibration, errors, notes, labels)
    check, calibration = with_check(content, calibration, measured, experiment)
    judge_test_poses(content, calibration, measured)
    halves = with_halves(content, calibration, measured, experiment, area_of(experiment))
    content["instruments"] = instruments
    content["extension"] = extension_facts(calibration.extension)
    content["remainder"] = remainder_facts(calibration, np.random.default_rng(experiment.seed), area_of(experiment))
    calibration = decided(content, calibration, measured, errors, experiment)
    content["controller"] = correction_facts(calibration.robot)
    content["compensation"] = None
    if handover is not None:
        from symcal.export.results import handover_facts

        content["compensation"] = handover_facts(handover)
    if found.images:
        content["measured_images"] = {entry.name: entry.facts for entry in found.images}
    if found.rendered is not None:
        from symcal.images.facts import camera_facts, point_facts

        content["camera"] = camera_facts(found.rendered.calibration, found.rendered.lens)
        content["measured_images"][found.images[0].name] |= point_facts(found.rendered.error_px)
    return Outcome(
        experiment,
        measured,
        planned,
        found.inputs,
        calibration,
        errors,
        handover,
        content,
        check,
        halves,
        measured_in=found.images,
        rendered=found.rendered,
    )


def _calibrated(experiment: Experiment, measured: Dataset) -> Calibration:
    """The identification, beyond geometry where that is asked for."""
    model, groups = experiment.model, experiment.file.identification.groups
    try:
        return calibrate_extended(model, baseline_model(model), measured, experiment.options, groups)
    except InputError as error:
        raise experiment.document.error(error.message, ("identification", "extend"), found=error.found) from None


def _spelling(file: ExperimentFile) -> list[str]:
    """What is said once of a spelling that has a better one."""
    if file.measurement is None or not file.measurement.invert:
        return []
    return [
        "'invert: true' is now spelt: measurements: {camera: {instrument: pose, at: {on: tool}, target: {on: world}}}, "
        "with 'reports: instrument' where the data hold the camera's own pose"
    ]


def _with_images(experiment: Experiment, progress: Progress) -> Outcome:
    """A simulated measurement with a camera, judged against the truth."""
    from symcal.export.results import handover_facts
    from symcal.images.run import AGAINST, ERROR, run_images

    own = (experiment.file, experiment.document, experiment.model, experiment.options)
    found = run_images(*own, experiment.seed, progress)
    calibration = found.calibration
    notes = [*found.notes, *optimism(found.errors)]
    inputs = (experiment.document.path, experiment.robot_path, *found.inputs)
    labels = {"train": found.data.labels, "test": unseen(len(found.test))}
    own_model = replace(experiment, model=found.model)
    content = _content(own_model, found.data, inputs, calibration, found.errors, notes, labels)
    check, calibration = with_check(content, calibration, found.data, experiment)
    halves = with_halves(content, calibration, found.data, experiment, area_of(experiment))
    content |= found.facts
    content["against"] = AGAINST
    content["measurement"] |= {"error": ERROR, "of_tool": True}  # positions against the truth
    content["measurement"]["poses"]["test"] = len(found.test)
    handover = _handover(experiment, calibration, found.truth, np.random.default_rng(experiment.seed))
    calibration = decided(content, calibration, found.data, found.errors, experiment, found.test)
    content["controller"] = correction_facts(calibration.robot)
    content["compensation"] = handover_facts(handover)
    return Outcome(
        experiment,
        found.data,
        found.planned,
        found.inputs,
        calibration,
        found.errors,
        handover,
        content,
        check,
        halves,
        found,
    )


def _handover(experiment: Experiment, calibration: Calibration, truth: Robot, rng: np.random.Generator) -> Handover:
    """Commands over the working area, executed by the true robot."""
    from symcal.calibration.compensation_check import POSES, hand_over

    (own,) = rng.spawn(1)
    lower, upper = config.area_of(experiment.file, experiment.document, experiment.robot)
    joints = own.uniform(lower, upper, (POSES, len(lower)))
    return hand_over(
        calibration.robot, truth, joints, own, aligned=experiment.model.task.base or experiment.model.measurement.adrift
    )


def plan_of(experiment: Experiment, progress: Progress) -> Planned | None:
    """The plan that simulated data are taken at; None where the file names no method, or they are not simulated."""
    wanted = experiment.file.plan
    if not isinstance(experiment.file.data, SimulatedData | RenderedData) or wanted.method is None:
        return None
    from symcal.planning.drive_plan import find_plan, plan_generator
    from symcal.planning.plan_problem import plan_problem

    progress("planning")
    rng = plan_generator(experiment.seed)
    model = planned_model(experiment.model, experiment.file.identification.groups)
    problem = plan_problem(experiment.file, experiment.document, model, rng)
    return find_plan(problem, wanted.model_copy(update={"random": 0}), rng, progress)


def _content(
    experiment: Experiment,
    data: Dataset,
    inputs: Sequence[Path],
    calibration: Calibration,
    errors: Mapping[str, Mapping[str, Errors]],
    notes: Sequence[str],
    labels: Mapping[str, Sequence[str]],
) -> dict[str, Any]:
    """What results.json says of every identification.

    Args:
        labels: of the poses of each part whose worst one has a name.
    """
    file = experiment.file
    poses: dict[str, int] = {
        split: data.split.count(split) for split in ("train", "test", "unused") if split in data.split
    }
    accuracy: dict[str, Any] = {name: results.accuracy_facts(found, labels.get(name)) for name, found in errors.items()}
    if "cross_validation" in accuracy:
        accuracy["cross_validation"]["folds"] = file.validation.folds or 5
    expected = {
        split: float(np.sqrt(np.mean(expected_position_rms(calibration.model, calibration.after, q) ** 2)))
        for split in ("train", "test")
        if split in data.split
        for q in (data.part(split).few().q,)
    }
    return {
        **results.header(file.name, file.title, experiment.seed, inputs, experiment.document.path.parent.resolve()),
        "robot": results.robot_facts(experiment.robot),
        "measurement": results.measurement_facts(experiment.model.task, poses),
        "warnings": list(notes),
        **results.calibration_facts(calibration, data.part("test") if "test" in data.split else None),
        "accuracy": accuracy,
        "expected_position_rms_mm": expected,
        "promise": forecast_check(file, experiment.model, data, errors),
        "against": results.against(experiment.model.task),
    }
