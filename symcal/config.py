"""The experiment file: strict schema, units converted once, paths resolved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from symcal.documents import Document, Key, Strict, read_document, validate
from symcal.errors import InputError
from symcal.estimation import Options
from symcal.least_squares import Tolerances
from symcal.measurement_file import Split
from symcal.model import Task
from symcal.robot import Robot
from symcal.units import ANGLE, LENGTH, AngleUnit, LengthUnit

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0)]
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]

SCHEMA: Literal["symcal/experiment/1"] = "symcal/experiment/1"


class Units(Strict):
    """Units of the numbers in this file."""

    length: LengthUnit
    angle: AngleUnit

    def factor(self, unit: str) -> float:
        """mm or rad per unit of the file, for a parameter of unit `mm` or `rad`."""
        return ANGLE[self.angle] if unit == "rad" else LENGTH[self.length]


class KnownNoise(Strict):
    """Known standard deviation per axis; what is absent is estimated from the training data."""

    position: Positive | None = None
    orientation: Positive | None = None


class MeasurementConfig(Strict):
    """What is measured.

    points: tool points in the tool frame by name (`position`); `null` for coordinates that are to be estimated.
    estimate: what of base, tool (mount) and points is unknown. invert: pose data are T_tool_world (eye in hand).
    """

    type: Literal["position", "pose"]
    points: dict[str, Triple | None] = {}
    estimate: list[Literal["base", "tool", "points"]] = []
    invert: bool = False
    noise: KnownNoise = KnownNoise()

    @model_validator(mode="after")
    def _consistent(self) -> MeasurementConfig:
        unknown = [name for name, xyz in self.points.items() if xyz is None]
        if unknown and "points" not in self.estimate:
            raise PydanticCustomError(
                "points",
                "the point {name} has no coordinates: give them, or add 'points' to 'estimate'",
                {"name": unknown[0]},
            )
        if self.points and self.type == "pose":
            raise PydanticCustomError(
                "points", "a pose measurement has no points: give the tool frame in the robot file"
            )
        return self


class SplitConfig(Strict):
    """Which poses train and which test: labels of a column, or a random share."""

    column: str | None = None
    train: list[str] = ["train"]
    test: list[str] = ["test"]
    test_fraction: Annotated[float, Field(gt=0, lt=1)] | None = None


class FileData(Strict):
    """Measurements from a CSV file. columns: canonical name -> name in the file."""

    source: Literal["file"]
    file: str
    columns: dict[str, str] = {}
    split: SplitConfig = SplitConfig()
    delimiter: Literal[",", ";", "\t"] | None = None
    decimal: Literal[".", ","] = "."


class Truth(Strict):
    """The simulated robot's errors: given by name, or drawn with a standard deviation per kind."""

    units: Units | None = None
    errors: dict[str, float] = {}
    sigma_length: Annotated[float, Field(ge=0)] = 0.0
    sigma_angle: Annotated[float, Field(ge=0)] = 0.0


class SimulatedNoise(Strict):
    """Noise of simulated measurements: normal (standard deviation) or uniform (half width), per axis."""

    distribution: Literal["normal", "uniform"] = "normal"
    position: Annotated[float, Field(ge=0)] = 0.0
    orientation: Annotated[float, Field(ge=0)] = 0.0


class SimulatedData(Strict):
    """Measurements made by the program: the planned poses train, random poses of the area test."""

    source: Literal["simulated"]
    truth: Truth
    noise: SimulatedNoise = SimulatedNoise()
    test_poses: Annotated[int, Field(ge=0)] = 1000


class PlanConfig(Strict):
    """Which poses to measure. area: ranges of the readings by joint name; the joint limits elsewhere."""

    method: Literal["random"] = "random"
    poses: Annotated[int, Field(ge=1)] = 40
    area: dict[str, Annotated[list[float], Field(min_length=2, max_length=2)]] = {}


class TolerancesConfig(Strict):
    """When the solver stops; see `symcal.least_squares.Tolerances`."""

    gradient: Positive = 1e-10
    cost: Positive = 1e-14
    step: Positive = 1e-12
    residual: Annotated[float, Field(ge=0)] = 0.0
    iterations: Annotated[int, Field(ge=1)] = 100


class IdentificationConfig(Strict):
    """How to identify.

    Scales: plausible size of an error; priors: standard deviation of a prior; both by parameter name.
    """

    solver: Literal["levenberg_marquardt", "gauss_newton", "ipopt"] = "levenberg_marquardt"
    loss: Literal["linear", "huber", "cauchy"] = "linear"
    tolerances: TolerancesConfig = TolerancesConfig()
    fix: list[str] = []
    scales: dict[str, Positive] = {}
    priors: dict[str, Positive] = {}


class ValidationConfig(Strict):
    """folds.

    K-fold cross-validation over training and test poses; 0 for none; by default 5 when there is no test split.
    """

    folds: Annotated[int, Field(ge=0)] | None = None


class OutputsConfig(Strict):
    report: bool = True
    figures: bool = True


class ExperimentFile(Strict):
    """One experiment: robot, measurement, data, identification, outputs."""

    schema_: Literal["symcal/experiment/1"] = Field(default=SCHEMA, alias="schema")
    name: Annotated[str, Field(min_length=1, pattern=r"^[\w][\w .+-]*$")]
    title: str | None = None
    seed: Annotated[int, Field(ge=0)] = 1
    units: Units
    robot: str
    measurement: MeasurementConfig
    plan: PlanConfig = PlanConfig()
    data: Annotated[FileData | SimulatedData, Field(discriminator="source")]
    identification: IdentificationConfig = IdentificationConfig()
    validation: ValidationConfig = ValidationConfig()
    outputs: OutputsConfig = OutputsConfig()


def load_experiment(path: Path | str, overrides: Sequence[str] = ()) -> tuple[ExperimentFile, Document]:
    """Read an experiment file.

    Args:
        overrides: `key.path=value` with the value in YAML, as `--set` takes them.
    Raises:
        InputError: with file, line and key for anything that is not as the schema says.
    """
    document = read_document(path)
    for override in overrides:
        _override(document, override)
    return validate(document, ExperimentFile), document


def _override(document: Document, text: str) -> None:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise InputError("expected key.path=value", key="--set", found=text)
    try:
        parsed: Any = yaml.safe_load(value)
    except yaml.YAMLError:
        raise InputError("the value is not YAML", key="--set", found=text) from None
    if isinstance(parsed, str):  # 1e-3 is a number here, as in the file
        with suppress(ValueError):
            parsed = float(parsed)
    *parents, last = key.strip().split(".")
    node: Any = document.data
    for part in parents:
        node = node.setdefault(part, {}) if isinstance(node, dict) else None
        if not isinstance(node, dict):
            raise InputError("this key has no keys of its own", file=document.path, key=key, found=part)
    node[last] = parsed


def existing(document: Document, path: str, key: Key, what: str) -> Path:
    """A file named in the experiment, as an absolute path that is there."""
    resolved = document.resolve(path, key)
    if not resolved.is_file():
        raise document.error(f"the {what} is not there", key, found=resolved)
    return resolved


def task_of(file: ExperimentFile, document: Document, robot: Robot) -> Task:
    """The identification task that an experiment describes, in mm and rad."""
    m, i, units = file.measurement, file.identification, file.units
    length = LENGTH[units.length]
    points: dict[str, tuple[float, float, float]] = {
        name: (0.0, 0.0, 0.0) if xyz is None else (xyz[0] * length, xyz[1] * length, xyz[2] * length)
        for name, xyz in m.points.items()
    }
    task = Task(
        kind=m.type,
        estimate=frozenset(m.estimate),
        points=points or {"P": (0.0, 0.0, 0.0)},
        invert=m.invert,
        fix=tuple(i.fix),
    )
    known = _unit_of(task, robot)
    converted: dict[str, dict[str, float]] = {"scales": {}, "priors": {}}
    for section, values in (("scales", i.scales), ("priors", i.priors)):
        for name, value in values.items():
            if name not in known:
                key = ("identification", section, name)
                raise document.error("no such parameter in this experiment", key, found=name, allowed=known)
            converted[section][name] = value * units.factor(known[name])
    for index, name in enumerate(i.fix):
        if name not in known:
            where: Key = ("identification", "fix", index)
            raise document.error("no such parameter in this experiment", where, found=name, allowed=known)
    return Task(task.kind, task.estimate, task.points, task.invert, task.fix, converted["scales"], converted["priors"])


def _unit_of(task: Task, robot: Robot) -> dict[str, str]:
    return dict(zip(task.parameters(robot).names, task.parameters(robot).units, strict=True))


def options_of(file: ExperimentFile) -> Options:
    """Solver, loss, tolerances and known noise, in mm and rad."""
    i, noise = file.identification, file.measurement.noise
    sigma: dict[str, float] = {}
    if noise.position is not None:
        sigma["position"] = noise.position * file.units.factor("mm")
    if noise.orientation is not None:
        sigma["orientation"] = noise.orientation * file.units.factor("rad")
    return Options(solver=i.solver, tolerances=Tolerances(**i.tolerances.model_dump()), loss=i.loss, sigma=sigma)


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
    data: SimulatedData, file: ExperimentFile, document: Document, units: Mapping[str, str], rng: np.random.Generator
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
