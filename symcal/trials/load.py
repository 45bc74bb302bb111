"""A study file with the experiment that it names, read and checked: everything that is made once, before any trial."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.candidates import terms_named
from symcal.config import conversion as config
from symcal.config.conversion import ExperimentFile, SimulatedData
from symcal.config.plan import MethodName
from symcal.config.trials import RANDOM, StudyFile
from symcal.documents.document import Document, Key, read_document, validate
from symcal.errors import InputError, RefusedError
from symcal.instruments.noise import Noise
from symcal.model.model import Model, build_model
from symcal.planning.area import WorkingArea
from symcal.planning.plan_constraints import asked_view
from symcal.planning.plan_file import read_plan
from symcal.runs.load import Experiment, load, named_files
from symcal.trials.description import Cell, Description, shared_generator
from symcal.trials.grid import NOISE, axes, combinations, varied
from symcal.trials.poses import pose_source
from symcal.trials.setting import insist_on_points

Array = NDArray[np.float64]
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Study:
    """A study that can be run.

    inputs: the files that it reads. identity: what makes it this study and no other, as a hash of all that the files
    say. axes: values of the grid by axis; varied: those with more than one.
    """

    file: StudyFile
    document: Document
    experiment: Experiment
    description: Description
    inputs: tuple[Path, ...]
    identity: str
    axes: Mapping[str, list[Any]]
    varied: tuple[str, ...]


def read_study(
    path: Path, *, seed: int | None = None, overrides: Sequence[str] = ()
) -> tuple[StudyFile, Document, Experiment]:
    """The file, and the experiment that it names.

    Raises:
        InputError: with file, line and key; an experiment whose data are not simulated.
    """
    document = read_document(path)
    for key, what in (("links", "a robot file"), ("robot", "an experiment")):
        if key in document.data:
            message = f"this is {what}: a study ('kind: study'), which names an experiment, is needed here"
            raise InputError(message, file=path, line=1)
    for text in overrides:
        document = config.overridden(document, text)
    file = validate(document, StudyFile)
    if seed is not None:
        file = file.model_copy(update={"seed": seed})
    named = config.existing(document, file.experiment, ("experiment",), "experiment")
    if read_document(named).data.get("kind") == "study":
        raise document.error("this is a study itself: name an experiment", ("experiment",), found=file.experiment)
    return file, document, load(named)


def load_study(
    path: Path,
    *,
    seed: int | None = None,
    overrides: Sequence[str] = (),
    portable: bool = False,
    progress: Progress = lambda _: None,
) -> Study:
    """Read a study, and make what all its trials share: plans, test poses, true errors.

    Raises:
        InputError: with file, line and key. RefusedError: an experiment that no study can be made of, or plans that
        cannot be made.
    """
    file, document, experiment = read_study(path, seed=seed, overrides=overrides)
    own, model = experiment.file, experiment.model
    data = own.data
    if not isinstance(data, SimulatedData):
        message = "a study repeats an experiment on simulated data, with 'data: {source: simulated, ...}'"
        found = None if data is None else data.source
        raise document.error(message, ("experiment",), found=found)
    _refuse_extensions(own, document)
    entries = tuple(dict.fromkeys(o.of for o in model.task.observations))
    noises = tuple(dict.fromkeys(q.noise for o in model.task.observations for q in o.instrument.quantities))
    grid = axes(file, document, own, entries, noises)
    sets: list[tuple[str, ...]] = grid["instruments"]
    models = [_model(experiment, document, names, entries) for names in sets]
    lower, upper = config.area_of(own, experiment.document, experiment.robot)
    terms = terms_named(experiment.robot, data.truth.errors)
    true_model = model
    if terms:
        from symcal.calibration.extend import with_terms

        true_model = with_terms(model, terms)
    units = dict(zip(true_model.parameters.names, true_model.parameters.units, strict=True))
    for_truth = shared_generator(file.seed, "truth")
    truth = config.truth_of(data, own, experiment.document, dict(units), for_truth)
    view = asked_view(own)
    area = WorkingArea(lower, upper)
    cells, plans, read = _cells(file, document, experiment, grid, models, data, progress)
    inputs = tuple(dict.fromkeys((document.path, *named_files(experiment), *read)))
    description = Description(
        name=file.name,
        seed=file.seed,
        repetitions=file.repetitions,
        robot=experiment.robot,
        tasks=tuple(each.task for each in models),
        terms=tuple(terms),
        truth=truth,
        spread=_spread(data, own, model),
        lower=lower,
        upper=upper,
        view=view,
        plans=tuple(plans),
        test=pose_source(model, area, view)(shared_generator(file.seed, "test"), file.judge.test_poses),
        cells=tuple(cells),
        options=replace(experiment.options, sigma={}, scales=file.identification.sizes),
        told=file.identification.noise == "known",
        measured=file.judge.against == "measurement",
        portable=portable,
    )
    return Study(file, document, experiment, description, inputs, _identity(file, inputs, portable), grid, varied(grid))


def _refuse_extensions(own: ExperimentFile, document: Document) -> None:
    """What an identification may look for beyond the parameters of its model is not repeated."""
    asked = {
        "extend": bool(own.identification.groups),
        "remainder": own.identification.remainder != "none",
    }
    for key, given in asked.items():
        if given:
            message = (
                f"the experiment's 'identification.{key}' looks for more than the model has, which a study does not "
                "repeat: leave it out; joint terms that the true robot has may stand in its 'data.truth.errors'"
            )
            raise document.error(message, ("experiment",))


def _model(experiment: Experiment, document: Document, names: tuple[str, ...], entries: tuple[str, ...]) -> Model:
    """The model of some of the instruments."""
    try:
        model = experiment.model
        if names != entries:
            from symcal.planning.instrument_comparison import only_instruments

            model = build_model(experiment.robot, only_instruments(experiment.model.task, names))
        insist_on_points(model)
    except (InputError, RefusedError) as error:
        message = f"{', '.join(names)}: {getattr(error, 'message', error)}"
        raise document.error(message, ("vary", "instruments")) from None
    return model


def _spread(data: SimulatedData, own: ExperimentFile, model: Model) -> dict[str, float]:
    """Standard deviations of the errors that trials draw, by name, mm and rad."""
    units = data.truth.units or own.units
    given = {"mm": data.truth.sigma_length * units.factor("mm"), "rad": data.truth.sigma_angle * units.factor("rad")}
    items = {p.name: p for p in model.parameters.items}
    if any(given.values()):
        return {name: given.get(items[name].unit, 0.0) for name in model.kinematic}
    return {name: items[name].scale for name in model.kinematic}


def _cells(
    file: StudyFile,
    document: Document,
    experiment: Experiment,
    grid: Mapping[str, list[Any]],
    models: Sequence[Model],
    data: SimulatedData,
    progress: Progress,
) -> tuple[list[Cell], list[Array], list[Path]]:
    """The cells, the poses of their plans, and the files of these."""
    cells: list[Cell] = []
    plans: list[Array] = []
    places: dict[object, int] = {}
    read: list[Path] = []
    sets: list[tuple[str, ...]] = grid["instruments"]
    for number, values in enumerate(combinations(grid)):
        task = sets.index(values["instruments"])
        plan, poses = values["plan"], values["poses"]
        place: int | None = None
        if plan != RANDOM:
            key, made = _plan(file, document, experiment, plan, poses, task, models[task], places, read, progress)
            if made is not None:
                places[key] = len(plans)
                plans.append(made)
            place = places[key]
            if len(plans[place]) < poses:
                message = f"the plan has {len(plans[place])} poses"
                raise document.error(message, ("vary", "poses"), found=poses)
        noise = _noise(experiment.file, data, models[task], values)
        _insist_on_noise(document, models[task], noise, told=file.identification.noise == "known")
        shown = {**values, "instruments": " + ".join(sets[task])}
        drawn, size = values["errors"] == "drawn", float(values["size"])
        cells.append(Cell(number, poses, plan, place, sets[task], task, drawn, size, noise, shown))
    return cells, plans, read


def _plan(
    file: StudyFile,
    document: Document,
    experiment: Experiment,
    plan: str,
    poses: int,
    task: int,
    model: Model,
    places: Mapping[object, int],
    read: list[Path],
    progress: Progress,
) -> tuple[object, Array | None]:
    """What tells a plan from others, and its poses, shape (N, dof), unless it is there already."""
    if plan in get_args(MethodName):
        key = (plan, poses, task)
        return key, None if key in places else _planned(file, experiment, plan, poses, model, progress)
    where: Key = ("vary", "plan")
    if not plan.endswith(".csv"):
        allowed = (*get_args(MethodName), "a CSV file of poses")
        raise document.error("no such plan", where, found=plan, allowed=allowed)
    if plan in places:
        return plan, None
    path = config.existing(document, plan, where, "plan")
    found, _ = read_plan(path, model.robot)
    area = WorkingArea(model.robot.lower, model.robot.upper)
    if not area.contains(found).all():
        raise document.error("poses of this plan are outside the joint limits", where, found=plan)
    read.append(path)
    return plan, found


def _planned(
    file: StudyFile, experiment: Experiment, method: str, poses: int, model: Model, progress: Progress
) -> Array:
    """The poses of a plan that is made for the experiment, with its own noise."""
    from symcal.planning.drive_plan import find_plan, plan_generator
    from symcal.planning.plan_problem import plan_problem

    progress(f"planning {poses} poses ({method})")
    rng = plan_generator(file.seed)
    wanted = experiment.file.plan.model_copy(update={"method": method, "poses": poses, "random": 0})
    own = experiment.file.model_copy(update={"plan": wanted})
    return find_plan(plan_problem(own, experiment.document, model, rng), wanted, rng, progress).plan.poses


def _noise(own: ExperimentFile, data: SimulatedData, model: Model, values: Mapping[str, object]) -> Noise:
    """The noise of a cell: that of the experiment but for what the grid says of it."""
    said = {name.removeprefix(NOISE): value for name, value in values.items() if name.startswith(NOISE)}
    mixed = data.model_copy(update={"noise": data.noise.model_copy(update=said)})
    return config.noise_of(own, mixed, model.task.observations)


def _insist_on_noise(document: Document, model: Model, noise: Noise, *, told: bool) -> None:
    """Identifications that are told the noise must be told something."""
    for group in model.measurement.groups:
        size = {**noise.sizes, **noise.by_instrument.get(group.observation, {})}.get(group.quantity, 0.0)
        if told and not size > 0:
            message = f"no noise of the {group.name} is stated: give it here, or in the experiment's 'data.noise'"
            raise document.error(message, ("vary", "noise", group.quantity))


def _identity(file: StudyFile, inputs: Sequence[Path], portable: bool) -> str:
    """A hash of what the files say: of the study's own file the keys that decide numbers, of others every byte."""
    said: dict[str, Any] = file.model_dump(mode="json", by_alias=True, exclude={"title", "outputs", "name"})
    said["judge"] = {key: said["judge"][key] for key in ("test_poses", "against")}
    digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in inputs[1:] if path.is_file()]
    text = json.dumps([said, digests, portable], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
