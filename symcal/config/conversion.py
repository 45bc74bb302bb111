"""The experiment file, read: overrides applied, units converted once, paths resolved."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from symcal.calibration.tolerance import Tolerance
from symcal.config.data_sources import FileData as FileData
from symcal.config.data_sources import ImagesData as ImagesData
from symcal.config.data_sources import SplitConfig
from symcal.config.data_sources import TableData as TableData
from symcal.config.experiment import ExperimentFile as ExperimentFile
from symcal.config.experiment import RenderedData as RenderedData
from symcal.config.experiment import SimulatedData as SimulatedData
from symcal.config.experiment import experiment_type
from symcal.config.observations import board_of as board_of
from symcal.config.observations import observed
from symcal.config.sources import existing as existing
from symcal.config.sources import files_of as files_of
from symcal.config.sources import joints_of as joints_of
from symcal.config.sources import layout_of as layout_of
from symcal.config.sources import like
from symcal.config.sources import reads_files as reads_files
from symcal.config.sources import sources as sources
from symcal.config.sources import table_of as table_of
from symcal.data.measurement_file import Split
from symcal.documents.document import Document, Key, read_document, validate
from symcal.documents.yaml_dialect import parse_value
from symcal.errors import InputError
from symcal.fit.options import Options
from symcal.instruments.noise import Noise
from symcal.model.measurement import Measurement
from symcal.model.observation import Observation
from symcal.model.soundness import insist_on_values
from symcal.model.task import Task
from symcal.parameters import check_size
from symcal.robot.given import GIVEN_FILE, NO_JOINTS, is_given
from symcal.robot.robot import Robot
from symcal.solvers.least_squares import Tolerances
from symcal.words import GIVEN, is_term_number

Array = NDArray[np.float64]


def load_experiment(path: Path | str, overrides: Sequence[str] = ()) -> tuple[ExperimentFile, Document]:
    """Read an experiment file.

    Args:
        overrides: `key.path=value` with the value in YAML, as `--set` takes them; errors then name the option.
    Raises:
        InputError: with file, line and key for anything that is not as the schema says.
    """
    document = read_document(path)
    if "links" in document.data:
        raise InputError("this is a robot file: an experiment, which names a robot, is needed here", file=path, line=1)
    if document.data.get("kind") == "study":
        raise InputError("this is a study, which repeats an experiment: 'symcal study' runs it", file=path, line=1)
    for override in overrides:
        document = overridden(document, override)
    model = experiment_type(document.data["measurements"]) if "measurements" in document.data else ExperimentFile
    return validate(document, model), document


def overridden(document: Document, text: str) -> Document:
    """A document with one `key.path=value` of `--set`.

    Raises:
        InputError: it is not of this form, or the value is not YAML.
    """
    key, equals, value = text.partition("=")
    parts: Key = tuple(key.strip().split("."))
    if not equals or not all(parts):
        raise InputError("expected key.path=value", key="--set", found=text)
    try:
        return document.with_value(parts, parse_value(value))
    except yaml.YAMLError:
        raise InputError("the value is not YAML", key="--set", found=text) from None


_PATHS: tuple[tuple[str, ...], ...] = (
    ("robot",),
    ("measurement", "camera"),
    ("measurement", "target"),
    ("measurements", "*", "data", "file"),
    ("measurements", "*", "data", "files"),
    ("measurements", "*", "data", "joints"),
    ("measurements", "*", "camera"),
    ("measurements", "*", "target", "file"),
    ("targets", "*", "file"),
    ("data", "file"),
    ("data", "files"),
    ("data", "joints"),
    ("data", "camera"),
    ("plan", "required"),
    ("plan", "candidates"),
    ("plan", "region", "file"),
    ("plan", "constraints", "camera", "file"),
    ("plan", "constraints", "camera", "target"),
)


def resolved(file: ExperimentFile, document: Document, folder: Path) -> dict[str, Any]:
    """The experiment with all defaults filled in, as it can be run again from ``folder``.

    Paths become relative to the folder; those with an environment variable stay as they are.
    """
    data: dict[str, Any] = file.model_dump(mode="json", by_alias=True, exclude_none=True)
    for path in _PATHS:
        _each_path(data, path, (), lambda text, key: _seen_from(folder, text, key, document))
    if file.robot == GIVEN:
        data["robot"] = GIVEN
    return data


def named_paths(file: ExperimentFile, document: Document) -> tuple[Path, ...]:
    """Every file and folder that an experiment names, there or not; none whose environment variable is not set."""
    data: dict[str, Any] = file.model_dump(mode="json", by_alias=True, exclude_none=True)
    found: list[Path] = []

    def note(path: str, key: Key) -> str:
        with contextlib.suppress(InputError):
            found.extend(like(document.resolve(path, key)))
        return path

    for path in _PATHS:
        _each_path(data, path, (), note)
    return tuple(dict.fromkeys(found))


def _each_path(node: Any, path: tuple[str, ...], at: Key, become: Callable[[str, Key], str]) -> None:
    """Let every path under a key, `*` standing for every key, become another text."""
    if not isinstance(node, dict):
        return
    first, *rest = path
    for name in list(node) if first == "*" else [first] if first in node else []:
        value, key = node[name], (*at, name)
        if rest:
            _each_path(value, tuple(rest), key, become)
        elif isinstance(value, list):
            node[name] = [become(each, key) for each in value]
        elif isinstance(value, str):
            node[name] = become(value, key)


def _seen_from(folder: Path, path: str, key: Key, document: Document) -> str:
    return path if "$" in path else os.path.relpath(document.resolve(path, key), folder.resolve())


def robot_file_of(file: ExperimentFile, document: Document) -> Path:
    """The robot file that an experiment names: a file, or `given_poses`, which is ours."""
    if file.robot == GIVEN:
        return GIVEN_FILE
    return existing(document, file.robot, ("robot",), "robot file")


def task_of(file: ExperimentFile, document: Document, robot: Robot) -> Task:
    """The identification task that an experiment describes, in mm and rad.

    Raises:
        InputError: parts that cannot be estimated together, a point without coordinates, or a parameter that is not
        there.
    """
    i, units = file.identification, file.units
    if is_given(robot) and (i.groups or i.remainder != "none"):
        key: Key = ("identification", "extend" if i.groups else "remainder")
        raise document.error(NO_JOINTS, key)
    exact = tuple(robot.parameters) if is_given(robot) else ()
    task = replace(observed(file, document), fix=tuple(dict.fromkeys((*exact, *i.fix))))
    try:
        known = _unit_of(replace(task, fix=()), robot)
    except InputError as error:
        raise _at(error, file, document) from None
    converted: dict[str, dict[str, float]] = {"scales": {}, "priors": {}}
    for section, values in (("scales", i.scales), ("priors", i.priors)):
        for name, value in values.items():
            if name not in known:
                key = ("identification", section, name)
                raise document.error("no such parameter in this experiment", key, found=name, allowed=known)
            converted[section][name] = value * units.factor(known[name])
            try:
                check_size(name, converted[section][name])
            except InputError as error:
                raise document.error(error.message, ("identification", section, name), found=value) from None
    for index, name in enumerate(i.fix):
        if name not in known:
            where: Key = ("identification", "fix", index)
            raise document.error("no such parameter in this experiment", where, found=name, allowed=known)
    for section, names in (("fix", i.fix), ("priors", list(i.priors))):
        try:
            insist_on_values(task.observations, names)
        except InputError as error:
            raise document.error(error.message, ("identification", section), found=error.found) from None
    return replace(task, scales=converted["scales"], priors=converted["priors"])


def _at(error: InputError, file: ExperimentFile, document: Document) -> InputError:
    """The error of a task where the file says so: in short, under `measurement.estimate`."""
    key: Key = tuple((error.key or "measurements").split("."))
    if file.measurement is not None and key[0] != "measurement":
        key = ("measurement", "estimate")
    return document.error(error.message, key, found=error.found, allowed=error.allowed)


def _unit_of(task: Task, robot: Robot) -> dict[str, str]:
    parameters = task.parameters(robot)
    return dict(zip(parameters.names, parameters.units, strict=True))


def options_of(file: ExperimentFile, measurement: Measurement) -> Options:
    """Solver, loss, tolerances, known noise of the measurement's groups, and whether the sizes hold as stated."""
    i = file.identification
    return Options(
        solver=i.solver,
        tolerances=Tolerances(**i.tolerances.model_dump()),
        loss=i.loss,
        sigma=measurement.stated_noise,
        scales=i.scale_factor,
    )


def tolerance_of(file: ExperimentFile) -> Tolerance | None:
    """What the experiment is accepted or refused against, mm and rad; None where the file says nothing."""
    said = file.validation.tolerance
    if said is None:
        return None
    position, angle = said.position, said.orientation
    return Tolerance(
        None if position is None else position * file.units.factor("mm"),
        None if angle is None else angle * file.units.factor("rad"),
        said.of,
    )


def noise_of(file: ExperimentFile, data: SimulatedData, observations: Iterable[Observation]) -> Noise:
    """The noise that simulated data have: as said with them, else as stated of the instruments."""
    units = {q.noise: q.unit for o in observations for q in o.instrument.quantities}
    said = {name: value * file.units.factor(units[name]) for name, value in data.noise.sizes.items() if name in units}
    stated = {o.of: {name: value for name, value in o.noise.items() if name not in said} for o in observations}
    return Noise(data.noise.distribution, by_instrument=stated, **said)


def split_of(config: SplitConfig) -> Split:
    return Split(config.column, tuple(config.train), tuple(config.test), config.test_fraction)


def area_of(file: ExperimentFile, document: Document, robot: Robot) -> tuple[Array, Array]:
    """Lower and upper readings of the working area, shape (dof,) each, rad and mm.

    Raises:
        InputError: an unknown joint, a range outside the limits, or a joint that has neither limits nor a range.
    """
    lower, upper = robot.lower.copy(), robot.upper.copy()
    names = [joint.name for joint in robot.joints]
    for name, (low, high) in file.plan.area.items():
        key = ("plan", "area", name)
        if name not in names:
            raise document.error("no such joint", key, found=name, allowed=names)
        i = names.index(name)
        factor = file.units.factor("rad" if robot.joints[i].revolute else "mm")
        low, high = low * factor, high * factor
        if not low < high or low < robot.lower[i] - 1e-9 or high > robot.upper[i] + 1e-9:
            raise document.error("the range must be [lower, upper] within the joint's limits", key, found=[low, high])
        lower[i], upper[i] = low, high
    for i, name in enumerate(names):
        if not np.isfinite(upper[i] - lower[i]):
            message = "this joint has no limits in the robot file: give its range here"
            raise document.error(message, ("plan", "area"), found=name)
    return lower, upper


def truth_of(
    data: SimulatedData | RenderedData,
    file: ExperimentFile,
    document: Document,
    units: Mapping[str, str],
    rng: np.random.Generator,
) -> dict[str, float]:
    """Errors of the simulated robot by parameter name, mm and rad.

    Those given, and random ones for all others if asked for.
    """
    own = data.truth.units or file.units
    errors = {}
    for name, unit in units.items():
        sigma = {"rad": data.truth.sigma_angle, "mm": data.truth.sigma_length}.get(unit)
        if sigma and not is_term_number(name):  # numbers of cameras are neither, and joint terms no links
            errors[name] = float(rng.normal()) * sigma * own.factor(unit)
    for name, value in data.truth.errors.items():
        if name not in units:
            raise document.error("no such parameter", ("data", "truth", "errors", name), found=name, allowed=units)
        errors[name] = value * own.factor(units[name])
    return errors
