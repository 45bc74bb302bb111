"""The experiment file, read: overrides applied, units converted once, paths resolved."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from symcal.camera.files import read_camera, read_target
from symcal.config.experiment import ExperimentFile as ExperimentFile
from symcal.config.experiment import FileData as FileData
from symcal.config.experiment import RenderedData as RenderedData
from symcal.config.experiment import SimulatedData as SimulatedData
from symcal.config.experiment import SplitConfig
from symcal.data.measurement_file import Split
from symcal.documents.document import Document, Key, read_document, validate
from symcal.documents.yaml_dialect import parse_value
from symcal.errors import InputError
from symcal.fit.estimation import Options
from symcal.instruments.registry import kind_named
from symcal.model.model import Scene, Task, pixels_task
from symcal.parameters import check_size
from symcal.robot.robot import Robot
from symcal.solvers.least_squares import Tolerances
from symcal.units import LENGTH

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
    for override in overrides:
        document = _override(document, override)
    return validate(document, ExperimentFile), document


def _override(document: Document, text: str) -> Document:
    key, equals, value = text.partition("=")
    parts: Key = tuple(key.strip().split("."))
    if not equals or not all(parts):
        raise InputError("expected key.path=value", key="--set", found=text)
    try:
        return document.with_value(parts, parse_value(value))
    except yaml.YAMLError:
        raise InputError("the value is not YAML", key="--set", found=text) from None


def existing(document: Document, path: str, key: Key, what: str) -> Path:
    """A file named in the experiment, as an absolute path that is there."""
    resolved = document.resolve(path, key)
    if not resolved.is_file():
        raise document.error(f"the {what} is not there", key, found=resolved)
    return resolved


_PATHS: tuple[tuple[str, ...], ...] = (
    ("robot",),
    ("measurement", "camera"),
    ("measurement", "target"),
    ("data", "file"),
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
    for *parents, last in _PATHS:
        node: Any = data
        for part in parents:
            node = node.get(part, {}) if isinstance(node, dict) else {}
        path = node.get(last) if isinstance(node, dict) else None
        if isinstance(path, str) and "$" not in path:
            node[last] = os.path.relpath(document.resolve(path, (*parents, last)), folder.resolve())
    return data


def task_of(file: ExperimentFile, document: Document, robot: Robot) -> Task:
    """The identification task that an experiment describes, in mm and rad.

    Raises:
        InputError: parts that cannot be estimated together, a point without coordinates, or a parameter that is not
        there.
    """
    m, i, units = file.measurement, file.identification, file.units
    if m.points and not kind_named(m.type).reads_points:
        message = "a pose measurement has no points: give the tool frame in the robot file"
        raise document.error(message, ("measurement", "points"))
    for name, xyz in m.points.items():
        if xyz is None and "points" not in m.estimate:
            message = "this point has no coordinates: give them, or add 'points' to 'estimate'"
            raise document.error(message, ("measurement", "points", name))
    length = LENGTH[units.length]
    points: dict[str, tuple[float, float, float]] = {
        name: (0.0, 0.0, 0.0) if xyz is None else (xyz[0] * length, xyz[1] * length, xyz[2] * length)
        for name, xyz in m.points.items()
    }
    if kind_named(m.type).place:
        task = pixels_task(scene_of(file, document), m.estimate, fix=tuple(i.fix))
    else:
        task = Task(
            kind=m.type,
            estimate=frozenset(m.estimate),
            points=points or {"P": (0.0, 0.0, 0.0)},
            invert=m.invert,
            fix=tuple(i.fix),
        )
    try:
        known = _unit_of(task, robot)
    except InputError as error:
        raise document.error(error.message, tuple((error.key or "").split(".")), found=error.found) from None
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
    return replace(task, scales=converted["scales"], priors=converted["priors"])


def scene_of(file: ExperimentFile, document: Document) -> Scene:
    """Camera, target and rough camera pose of a pixel measurement.

    Raises:
        InputError: files that are not there or cannot be read, or a direction of view that is none.
    """
    m, units = file.measurement, file.units
    camera = read_camera(existing(document, str(m.camera), ("measurement", "camera"), "camera file"))
    target = read_target(existing(document, str(m.target), ("measurement", "target"), "target file"))
    if m.camera_pose is None:
        return Scene(camera, target)
    try:
        return Scene(camera, target, m.camera_pose.matrix(units.factor("mm"), units.factor("rad")))
    except InputError as error:
        raise document.error(error.message, ("measurement", "camera_pose"), found=error.found) from None


def _unit_of(task: Task, robot: Robot) -> dict[str, str]:
    return dict(zip(task.parameters(robot).names, task.parameters(robot).units, strict=True))


def options_of(file: ExperimentFile) -> Options:
    """Solver, loss, tolerances, known noise in mm and rad, and whether the sizes hold as stated."""
    i, noise = file.identification, file.measurement.noise
    sigma: dict[str, float] = {}
    if noise.position is not None:
        sigma["position"] = noise.position * file.units.factor("mm")
    if noise.orientation is not None:
        sigma["orientation"] = noise.orientation * file.units.factor("rad")
    if noise.image is not None:
        sigma["image"] = noise.image
    return Options(
        solver=i.solver,
        tolerances=Tolerances(**i.tolerances.model_dump()),
        loss=i.loss,
        sigma=sigma,
        scales=i.scale_factor,
    )


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
        sigma = data.truth.sigma_angle if unit == "rad" else data.truth.sigma_length
        if sigma:
            errors[name] = float(rng.normal()) * sigma * own.factor(unit)
    for name, value in data.truth.errors.items():
        if name not in units:
            raise document.error("no such parameter", ("data", "truth", "errors", name), found=name, allowed=units)
        errors[name] = value * own.factor(units[name])
    return errors
