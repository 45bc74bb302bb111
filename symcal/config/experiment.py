"""What an experiment file may say: its keys, their types, their defaults.

Numbers here are still in the file's units; `symcal.config.conversion` converts them.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError, PydanticKnownError

from symcal.config.plan import PlacementConfig, PlanConfig
from symcal.config.study import StudyConfig
from symcal.documents.document import Strict
from symcal.instruments.registry import KINDS
from symcal.units import ANGLE, LENGTH, AngleUnit, LengthUnit

Positive = Annotated[float, Field(gt=0)]
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]

SCHEMA: Literal["symcal/experiment/1"] = "symcal/experiment/1"


class Units(Strict):
    """Units of the numbers in this file."""

    length: LengthUnit
    angle: AngleUnit

    def factor(self, unit: str) -> float:
        """mm or rad per unit of the file, for a parameter of unit `mm` or `rad`; 1 for `px` and plain numbers."""
        return ANGLE[self.angle] if unit == "rad" else LENGTH[self.length] if unit == "mm" else 1.0


class KnownNoise(Strict):
    """Known standard deviation per axis; what is absent is estimated from the training data."""

    position: Positive | None = None
    orientation: Positive | None = None
    image: Positive | None = None


def _registered(name: str) -> str:
    if name not in KINDS:
        raise PydanticKnownError("literal_error", {"expected": ", ".join(map(repr, KINDS))})
    return name


KindName = Annotated[str, AfterValidator(_registered), WithJsonSchema({"enum": list(KINDS), "type": "string"})]
"""The name of a registered kind of instrument."""


class MeasurementConfig(Strict):
    """What is measured.

    points: tool points in the tool frame by name (`position`); `null` for coordinates that are to be estimated.
    estimate: what of base, tool (mount) and points is unknown. invert: pose data are T_tool_world (eye in hand).
    Of `pixels`: camera, a camera.yaml; target, a target.yaml; camera_pose, where the camera roughly is in world (plans
    and simulations need it, identifications find it). Mount (tool), camera and intrinsics are unknown unless `estimate`
    says otherwise.
    """

    type: KindName
    points: dict[str, Triple | None] = {}
    estimate: list[Literal["base", "tool", "points", "camera", "intrinsics"]] = []
    invert: bool = False
    noise: KnownNoise = KnownNoise()
    camera: str | None = None
    target: str | None = None
    camera_pose: PlacementConfig | None = None

    @model_validator(mode="before")
    @classmethod
    def _unknown_by_default(cls, data: Any) -> Any:
        kind = KINDS.get(str(data.get("type"))) if isinstance(data, dict) else None
        if kind is not None and kind.place and "estimate" not in data:
            return data | {"estimate": ["tool", "camera", "intrinsics"]}
        return data

    @model_validator(mode="after")
    def _scene(self) -> MeasurementConfig:
        given = [name for name in ("camera", "target", "camera_pose") if getattr(self, name) is not None]
        camera = bool(KINDS[self.type].place)
        if camera and (self.camera is None or self.target is None):
            raise PydanticCustomError("scene", "a pixel measurement needs 'camera' and 'target', files of theirs")
        if not camera and given:
            raise PydanticCustomError("scene", "'{name}' belongs to pixel measurements", {"name": given[0]})
        if camera and self.points:
            raise PydanticCustomError("scene", "a pixel measurement has the points of its target: leave them out")
        return self


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
    image: Annotated[float, Field(ge=0)] = 0.0


class SimulatedData(Strict):
    """Measurements made by the program: the planned poses train (random ones if no method of planning is named), random
    poses of the area test."""

    source: Literal["simulated"]
    truth: Truth
    noise: SimulatedNoise = SimulatedNoise()
    test_poses: Annotated[int, Field(ge=0)] = 1000


class ImageLook(Strict):
    """How rendered images are lit and taken: see `symcal.vision.render.Look`."""

    black: Annotated[float, Field(ge=0, le=1)] = 0.1
    white: Annotated[float, Field(ge=0, le=1)] = 0.85
    background: Annotated[float, Field(ge=0, le=1)] = 0.4
    blur_px: Annotated[float, Field(ge=0)] = 0.7
    noise: Annotated[float, Field(ge=0)] = 0.01
    vignetting: Annotated[float, Field(ge=0, le=1)] = 0.1


class RenderedData(Strict):
    """Images made by the program: a board for the camera's calibration, then the target at the planned poses.

    camera: a camera.yaml with the true numbers, which the identification is not told. board: as `symcal camera` has it.
    truth: errors of the robot, and of camera pose and mount (`camera_x`, `tool_rx`, ...) from the nominal ones.
    test_poses: unseen visible poses at which the result is judged against the truth. examples: images that are kept.
    """

    source: Literal["rendered"]
    truth: Truth
    camera: str
    board: str
    views: Annotated[int, Field(ge=3)] = 27
    image: ImageLook = ImageLook()
    test_poses: Annotated[int, Field(ge=3)] = 200
    examples: Annotated[int, Field(ge=0)] = 4


class TolerancesConfig(Strict):
    """When the solver stops; see `symcal.solvers.least_squares.Tolerances`."""

    gradient: Positive = 1e-10
    cost: Positive = 1e-14
    step: Positive = 1e-12
    residual: Annotated[float, Field(ge=0)] = 0.0
    iterations: Annotated[int, Field(ge=1)] = 100


class IdentificationConfig(Strict):
    """How to identify.

    scales: plausible size of a link parameter's error by name; priors: standard deviation of a prior, by name, instead
    of it. scale_factor: whether the data may make all plausible sizes larger by one factor, or they hold as stated;
    `scales: stated` says the latter in short.
    """

    solver: Literal["levenberg_marquardt", "gauss_newton", "ipopt"] = "levenberg_marquardt"
    loss: Literal["linear", "huber", "cauchy"] = "linear"
    tolerances: TolerancesConfig = TolerancesConfig()
    fix: list[str] = []
    scales: dict[str, Positive] = {}
    scale_factor: Literal["estimated", "stated"] = "estimated"
    priors: dict[str, Positive] = {}

    @model_validator(mode="before")
    @classmethod
    def _in_short(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("scales"), str):
            if "scale_factor" in data:
                message = "'scales: {word}' and 'scale_factor' speak of the same thing: give one of them"
                raise PydanticCustomError("scales", message, {"word": data["scales"]})
            return {**data, "scales": {}, "scale_factor": data["scales"]}
        return data


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
    data: Annotated[FileData | SimulatedData | RenderedData, Field(discriminator="source")] | None = None
    identification: IdentificationConfig = IdentificationConfig()
    validation: ValidationConfig = ValidationConfig()
    study: StudyConfig | None = None
    outputs: OutputsConfig = OutputsConfig()
