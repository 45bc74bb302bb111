"""What an experiment file may say: its keys, their types, their defaults.

Numbers here are still in the file's units; `symcal.config` converts them.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from symcal.documents import Strict
from symcal.plan_config import PlanConfig
from symcal.study_config import StudyConfig
from symcal.units import ANGLE, LENGTH, AngleUnit, LengthUnit

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


class SplitConfig(Strict):
    """Which poses train and which test: labels of a column, or a random share."""

    column: str | None = None
    train: list[str] = ["train"]
    test: list[str] = ["test"]
    test_fraction: Annotated[float, Field(gt=0, lt=1)] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> SplitConfig:
        if self.column is not None and self.test_fraction is not None:
            raise PydanticCustomError("split", "give 'column' or 'test_fraction', not both")
        for label in self.train:
            if label in self.test:
                message = "the label '{label}' stands under 'train' and under 'test'"
                raise PydanticCustomError("split", message, {"label": label})
        return self


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
    """Measurements made by the program: the planned poses train (random ones if no method of planning is named), random
    poses of the area test."""

    source: Literal["simulated"]
    truth: Truth
    noise: SimulatedNoise = SimulatedNoise()
    test_poses: Annotated[int, Field(ge=0)] = 1000


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


def _not_one(folds: int) -> int:
    if folds == 1:
        raise PydanticCustomError("folds", "one fold leaves nothing to train with: at least 2, or 0 for none")
    return folds


class ValidationConfig(Strict):
    """folds: of the cross-validation over training and test poses; 0 for none; 5 by default without a test split."""

    folds: Annotated[int, Field(ge=0), AfterValidator(_not_one)] | None = None


class OutputsConfig(Strict):
    """What a run leaves beside its numbers; c: the calibrated robot as C code, where nothing speaks against it."""

    report: bool = True
    figures: bool = True
    c: bool = False


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
    data: Annotated[FileData | SimulatedData, Field(discriminator="source")] | None = None
    identification: IdentificationConfig = IdentificationConfig()
    validation: ValidationConfig = ValidationConfig()
    study: StudyConfig | None = None
    outputs: OutputsConfig = OutputsConfig()
