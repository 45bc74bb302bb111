"""The one orchestrator: an experiment file in, a run's folder out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from symcal import config, results
from symcal.config import ExperimentFile, FileData, SimulatedData
from symcal.credibility import claim
from symcal.dataset import Dataset, with_random_test
from symcal.documents import Document, write_document
from symcal.errors import InputError, RefusedError
from symcal.estimation import Options
from symcal.evaluate import Errors, compare, cross_validate, expected_position_rms
from symcal.identify import Calibration, baseline_model, calibrate
from symcal.measurement_file import load_measurements, save_measurements
from symcal.model import Model, build_model
from symcal.plan_problem import plan_problem
from symcal.planned import Planned, find_plan, plan_generator
from symcal.planning.plan_file import write_plan
from symcal.promised import promise_kept
from symcal.robot import Robot, load_robot, save_robot
from symcal.run_folder import require_replaceable, run_folder, write_json
from symcal.run_tables import tables
from symcal.simulate import Noise, concatenate, simulate

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Experiment:
    """An experiment file with everything that it names, checked and in mm and rad."""

    file: ExperimentFile
    document: Document
    robot_path: Path
    robot: Robot
    model: Model
    options: Options
    seed: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """What an identification run found. planned: the plan behind simulated data, if they have one."""

    experiment: Experiment
    data: Dataset
    planned: Planned | None
    inputs: tuple[Path, ...]
    calibration: Calibration
    errors: Mapping[str, Mapping[str, Errors]]
    content: Mapping[str, Any]


def load(path: Path, *, seed: int | None = None, overrides: Sequence[str] = ()) -> Experiment:
    """Read an experiment with its robot and build its model.

    Raises:
        InputError: anything wrong in the files, with its line.
    """
    file, document = config.load_experiment(path, overrides)
    robot_path = config.existing(document, file.robot, ("robot",), "robot file")
    robot = load_robot(robot_path)
    model = build_model(robot, config.task_of(file, document, robot))
    options = config.options_of(file)
    return Experiment(file, document, robot_path, robot, model, options, file.seed if seed is None else seed)


def run(
    path: Path,
    out: Path | None = None,
    *,
    seed: int | None = None,
    overrides: Sequence[str] = (),
    data: Path | None = None,
    study: bool = True,
    progress: Progress = lambda _: None,
) -> tuple[Path, Mapping[str, Any]]:
    """Run an experiment and write its folder; `reports/<name>` below the current folder when ``out`` is None.

    Args:
        study: the whole study of an experiment that has one; False for a single identification.
    Returns:
        the folder, and the content of its results.json.
    """
    experiment = load(path, seed=seed, overrides=overrides)
    target = out or Path("reports") / experiment.file.name
    require_replaceable(target)
    if experiment.file.study is not None and study:
        from symcal.study_experiment import write_study

        return target, write_study(experiment, target, progress)
    outcome = identify_experiment(experiment, data=data, progress=progress)
    with run_folder(target) as folder:
        write(outcome, folder, progress)
    return target, outcome.content


def identify_experiment(experiment: Experiment, *, data: Path | None = None, progress: Progress) -> Outcome:
    """Measure (or read), identify, evaluate."""
    rng = np.random.default_rng(experiment.seed)
    planned = None if data else plan_of(experiment, progress)
    progress("reading the measurements" if isinstance(experiment.file.data, FileData) or data else "simulating")
    measured, exact, inputs = _measurements(experiment, data, planned, rng)
    progress("identifying")
    calibration = calibrate(experiment.model, baseline_model(experiment.model), measured, experiment.options)
    errors: dict[str, Mapping[str, Errors]] = {
        split: compare(calibration, measured.part(split)) for split in ("train", "test") if split in measured.split
    }
    if exact is not None:
        errors["truth"] = compare(calibration, exact)
    count = experiment.file.validation.folds
    if count is None:
        count = 0 if "test" in measured.split else 5
    notes = [*measured.notes, *calibration.notes]
    if count:
        progress(f"cross-validating in {count} folds")
        used = measured.take(np.array([s != "unused" for s in measured.split]))
        try:
            errors["cross_validation"] = cross_validate(experiment.model, used, experiment.options, count, rng)
        except RefusedError as error:
            notes.append(f"cross-validation was not possible: {error}")
    notes += claim(errors)
    content = _content(
        experiment, measured, (experiment.document.path, experiment.robot_path, *inputs), calibration, errors, notes
    )
    return Outcome(experiment, measured, planned, inputs, calibration, errors, content)


def describe_data(experiment: Experiment) -> tuple[str, ...]:
    """What the file of measurements holds and what looks wrong in it, or that it is not there.

    Raises:
        InputError: it is there and cannot be read.
    """
    source = experiment.file.data
    if not isinstance(source, FileData):
        return ()
    try:
        config.existing(experiment.document, source.file, ("data", "file"), "file of measurements")
    except InputError as error:
        return (str(error),)
    measured, _, _ = _measurements(experiment, None, None, np.random.default_rng(experiment.seed))
    counts = [f"{measured.split.count(s)} {s}" for s in ("train", "test", "unused") if s in measured.split]
    return (f"{len(measured)} poses ({', '.join(counts)})", *measured.notes)


def plan_of(experiment: Experiment, progress: Progress) -> Planned | None:
    """The plan that simulated data are taken at; None where the file names no method, or they are not simulated."""
    wanted = experiment.file.plan
    if not isinstance(experiment.file.data, SimulatedData) or wanted.method is None:
        return None
    progress("planning")
    rng = plan_generator(experiment.seed)
    problem = plan_problem(experiment.file, experiment.document, experiment.model, rng)
    return find_plan(problem, wanted.model_copy(update={"random": 0}), rng, progress)


def _measurements(
    experiment: Experiment, data: Path | None, planned: Planned | None, rng: np.random.Generator
) -> tuple[Dataset, Dataset | None, tuple[Path, ...]]:
    """The measurements; for simulated ones also the test poses without noise; and the files read."""
    file, document, model = experiment.file, experiment.document, experiment.model
    source = file.data
    if source is None and data is None:
        message = "there is nothing to identify from: give 'data' here, or measurements with --data"
        raise InputError(message, file=document.path, key="data")
    if isinstance(source, SimulatedData) and data is None:
        lower, upper = config.area_of(file, document, experiment.robot)
        units = dict(zip(model.parameters.names, model.parameters.units, strict=True))
        truth = config.truth_of(source, file, document, dict(units), rng)
        noise = Noise(
            source.noise.distribution,
            source.noise.position * file.units.factor("mm"),
            source.noise.orientation * file.units.factor("rad"),
        )
        random = rng.uniform(lower, upper, (file.plan.poses, len(lower)))
        train = simulate(model, truth, random if planned is None else planned.plan.poses, noise, rng)
        if not source.test_poses:
            return train, None, ()
        q = rng.uniform(lower, upper, (source.test_poses, len(lower)))
        test = simulate(model, truth, q, noise, rng, "test")
        return concatenate(train, test), simulate(model, truth, q, Noise(), rng, "test"), ()
    read = source if isinstance(source, FileData) else FileData(source="file", file=str(data))
    path = data or config.existing(document, read.file, ("data", "file"), "file of measurements")
    measured = load_measurements(
        path,
        experiment.robot,
        model.task.kind,
        point_names=model.task.point_names,
        columns=read.columns,
        split=config.split_of(read.split),
        delimiter=read.delimiter,
        decimal=read.decimal,
    )
    if read.split.test_fraction is not None:
        measured = with_random_test(measured, read.split.test_fraction, rng)
    return measured, None, (path,)


def _content(
    experiment: Experiment,
    data: Dataset,
    inputs: Sequence[Path],
    calibration: Calibration,
    errors: Mapping[str, Mapping[str, Errors]],
    notes: Sequence[str],
) -> dict[str, Any]:
    file = experiment.file
    poses: dict[str, int] = {
        split: data.split.count(split) for split in ("train", "test", "unused") if split in data.split
    }
    accuracy: dict[str, Any] = {name: results.accuracy_facts(found) for name, found in errors.items()}
    if "cross_validation" in accuracy:
        accuracy["cross_validation"]["folds"] = file.validation.folds or 5
    expected = {
        split: float(
            np.sqrt(np.mean(expected_position_rms(calibration.model, calibration.after, data.part(split).q) ** 2))
        )
        for split in ("train", "test")
        if split in data.split
    }
    return {
        **results.header(file.name, file.title, experiment.seed, inputs, experiment.document.path.parent.resolve()),
        "robot": results.robot_facts(experiment.robot),
        "measurement": results.measurement_facts(experiment.model.task, poses),
        "warnings": list(notes),
        **results.calibration_facts(calibration),
        "accuracy": accuracy,
        "expected_position_rms_mm": expected,
        "promise": promise_kept(file, experiment.model, data, errors),
        "against": "noisy measurement",
    }


def write(outcome: Outcome, folder: Path, progress: Progress) -> None:
    """Everything a run leaves: numbers, tables, robot, measurements, figures, report."""
    experiment, calibration = outcome.experiment, outcome.calibration
    write_json(folder / "results.json", outcome.content)
    save_robot(_with_provenance(outcome), folder / "calibrated.yaml")
    save_measurements(outcome.data, experiment.robot, folder / "measurements.csv")
    if outcome.planned is not None:
        motion = outcome.planned.motion if outcome.planned.timed else None
        write_plan(folder / "plan.csv", experiment.robot, outcome.planned.plan.poses, motion)
    resolved = config.resolved(experiment.file, experiment.document, folder)
    write_document(folder / "experiment.resolved.yaml", resolved | {"seed": experiment.seed})
    (folder / "tables").mkdir()
    for name, table in tables(outcome.content, calibration, outcome.data, outcome.errors).items():
        table.to_csv(folder / "tables" / f"{name}.csv", index=False)
    if not (experiment.file.outputs.figures or experiment.file.outputs.report):
        return
    from symcal.plots import identification_figures
    from symcal.report import save_figures, write_report

    progress("drawing")
    illustrations = identification_figures(calibration, outcome.data, outcome.errors)
    pictures = save_figures(illustrations, folder / "figures")
    if experiment.file.outputs.report:
        progress("writing the report")
        write_report(outcome.content, pictures, folder / "report.pdf")


def _with_provenance(outcome: Outcome) -> Robot:
    robot = outcome.calibration.robot
    if robot.record is None:
        return robot
    content = outcome.content
    facts = {k: content[k] for k in ("name", "seed", "versions", "inputs", "warnings", "accuracy", "against")}
    return replace(robot, record=replace(robot.record, provenance=dict(robot.record.provenance) | facts))
