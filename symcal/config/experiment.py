"""What an experiment file may say: its keys, their types, their defaults.

Numbers here are still in the file's units; `symcal.config.conversion` converts them.
"""

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, create_model, field_validator, model_validator
from pydantic_core import PydanticCustomError

from symcal.calibration.candidates import GROUPS, HIGHEST
from symcal.calibration.tolerance import Of
from symcal.config.counts import MOST
from symcal.config.data_sources import BagData, FileData, ImagesData, PairsData, TrajectoryData
from symcal.config.measurements import (
    MeasurementConfig,
    Name,
    TargetConfig,
    observation_type,
)
from symcal.config.noise import ByQuantity, Positive
from symcal.config.plan import PlanConfig
from symcal.config.study import StudyConfig
from symcal.documents.document import Strict
from symcal.instruments import KINDS, Instrument
from symcal.units import ANGLE, LENGTH, AngleUnit, LengthUnit, unit_factor

SCHEMA: Literal["symcal/experiment/1"] = "symcal/experiment/1"


class Units(Strict):
    """Units of the numbers in this file."""

    length: LengthUnit
    angle: AngleUnit

    def factor(self, unit: str) -> float:
        """What one of the file's units is in the program's, for such a parameter; 1 of `px` and plain numbers."""
        return unit_factor(unit, LENGTH[self.length], ANGLE[self.angle])


class Truth(Strict):
    """The simulated robot's errors: given by name, or drawn with a standard deviation per kind."""

    units: Units | None = None
    errors: dict[str, float] = {}
    sigma_length: Annotated[float, Field(ge=0)] = 0.0
    sigma_angle: Annotated[float, Field(ge=0)] = 0.0


class SimulatedNoise(ByQuantity):
    """Noise of simulated measurements: normal (standard deviation) or uniform (half width), per axis, by quantity.

    What is not said here is what `noise` of an instrument states.
    """

    distribution: Literal["normal", "uniform"] = "normal"


class SimulatedData(Strict):
    """Measurements made by the program: the planned poses train (random ones if no method of planning is named), random
    poses of the area test."""

    source: Literal["simulated"]
    truth: Truth
    noise: SimulatedNoise = SimulatedNoise.model_construct()
    test_poses: Annotated[int, Field(ge=0, le=MOST)] = 1000


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

    camera: a camera.yaml with the true numbers, which the identification is not told. board: as `symcal camera` has it;
    the measured board where that is one. seen: least share of a measured board's points that random poses show.
    truth: errors of the robot, and of camera pose and mount (`camera_x`, `tool_rx`, ...) from the nominal ones.
    test_poses: unseen visible poses at which the result is judged against the truth. examples: images that are kept.
    """

    source: Literal["rendered"]
    truth: Truth
    camera: str
    board: str | None = None
    seen: Annotated[float, Field(gt=0, le=1)] = 0.4
    views: Annotated[int, Field(ge=3, le=MOST)] = 27
    image: ImageLook = ImageLook.model_construct()
    test_poses: Annotated[int, Field(ge=3, le=MOST)] = 200
    examples: Annotated[int, Field(ge=0, le=MOST)] = 4


class TolerancesConfig(Strict):
    """When the solver stops; see `symcal.solvers.least_squares.Tolerances`."""

    gradient: Positive = 1e-10
    cost: Positive = 1e-14
    step: Positive = 1e-12
    residual: Annotated[float, Field(ge=0)] = 0.0
    iterations: Annotated[int, Field(ge=1, le=MOST)] = 100


class IdentificationConfig(Strict):
    """How to identify.

    loss: how residuals count. `linear`: by their squares. `huber`: by their size beyond the noise; meant for many small
    slips, not for gross errors, which draw it along still (a tenth of the poses off by 50 mm: 1.3 times the error that
    clean data leave, 1.5 times in one of ten sets). `cauchy` and `tukey` let go of what is far off (1.1 and 1.2 times).
    `auto`: of these four the one that foretells held-out poses best, the linear one unless another is clearly better.
    scales: plausible size of a link parameter's error by name; priors: standard deviation of a prior, by name, instead
    of it. scale_factor: whether the data may make all plausible sizes larger by one factor, or they hold as stated;
    `scales: stated` says the latter in short. extend: joint terms beyond geometry that the data may ask for: `auto`, or
    groups of them by name, such as [gravity, harmonics 1]. remainder: whether a smooth displacement over joint readings
    is looked for in what geometry and joint terms leave, and kept where held-out poses prove it.
    """

    solver: Literal["levenberg_marquardt", "gauss_newton", "ipopt"] = "levenberg_marquardt"
    loss: Literal["linear", "huber", "cauchy", "tukey", "auto"] = "linear"
    tolerances: TolerancesConfig = TolerancesConfig.model_construct()
    fix: list[str] = []
    scales: dict[str, Positive] = {}
    scale_factor: Literal["estimated", "stated"] = "estimated"
    priors: dict[str, Positive] = {}
    extend: Literal["none", "auto"] | list[str] = "none"
    remainder: Literal["none", "smooth"] = "none"

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of joint terms to try; none without `extend`."""
        if isinstance(self.extend, str):
            return () if self.extend == "none" else (self.extend,)
        return tuple(self.extend)

    @field_validator("extend")
    @classmethod
    def _known_groups(cls, value: str | list[str]) -> str | list[str]:
        for group in value if isinstance(value, list) else ():
            if group not in GROUPS:
                message = "no such group of joint terms: {group}; allowed: auto, or a list of {groups}"
                shown = ", ".join([g for g in GROUPS if not g.startswith("harmonics")] + [f"harmonics 1 to {HIGHEST}"])
                raise PydanticCustomError("extend", message, {"group": group, "groups": shown})
        return value

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


class ToleranceConfig(Strict):
    """How far the tool may be off, in the file's units; of: 95 % of the held-out errors, their rms, or the largest."""

    position: Positive | None = None
    orientation: Positive | None = None
    of: Of = "p95"

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.position is None and self.orientation is None:
            raise PydanticCustomError("tolerance", "say how far off the tool may be: position, orientation or both")
        return self


class ValidationConfig(Strict):
    """folds: of the cross-validation over training and test poses; 0 for none; 5 by default without a test split.
    tolerance: what the calibration is accepted or refused against; without one it must be better than the nominal robot
    by more than chance."""

    folds: Annotated[int, Field(ge=0, le=MOST), AfterValidator(_not_one)] | None = None
    tolerance: ToleranceConfig | None = None


class OutputsConfig(Strict):
    """What a run leaves beside its numbers.

    report: in PDF. html: the page that one can touch; as ``report`` where nothing is said. c: the calibrated robot as
    C code, where nothing speaks against it.
    """

    report: bool = True
    html: bool | None = None
    figures: bool = True
    c: bool = False

    @property
    def page(self) -> bool:
        return self.report if self.html is None else self.html


class ExperimentFile(Strict):
    """One experiment: robot, measurements, data, identification, outputs.

    base, tool: whether the robot's own frames are as its file says, or to be found; with `measurement` in short its
    `estimate` says so.
    """

    schema_: Literal["symcal/experiment/1"] = Field(default=SCHEMA, alias="schema")
    name: Annotated[str, Field(min_length=1, pattern=r"^[\w][\w .+-]*$")]
    title: str | None = None
    seed: Annotated[int, Field(ge=0)] = 1
    units: Units
    robot: str
    measurement: MeasurementConfig | None = None
    base: Literal["known", "unknown"] = "known"
    tool: Literal["known", "unknown"] = "known"
    targets: dict[Name, TargetConfig] = {}
    measurements: dict[Name, Any] = {}
    plan: PlanConfig = PlanConfig.model_construct()
    data: (
        Annotated[
            FileData | BagData | TrajectoryData | PairsData | ImagesData | SimulatedData | RenderedData,
            Field(discriminator="source"),
        ]
        | None
    ) = None
    identification: IdentificationConfig = IdentificationConfig.model_construct()
    validation: ValidationConfig = ValidationConfig.model_construct()
    study: StudyConfig | None = None
    outputs: OutputsConfig = OutputsConfig.model_construct()

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.measurement is None) == (not self.measurements):
            raise PydanticCustomError("measurement", "say what is measured: 'measurements', or 'measurement' in short")
        long = {"base": self.base == "unknown", "tool": self.tool == "unknown", "targets": bool(self.targets)}
        for key, given in long.items():
            if self.measurement is not None and given:
                message = "'{key}' goes with 'measurements'; with 'measurement' in short say it under 'estimate'"
                raise PydanticCustomError("measurement", message, {"key": key})
        return self


def experiment_type(measurements: object = None) -> type[ExperimentFile]:
    """The schema with the keys of every kind of instrument that is registered now.

    Args:
        measurements: as a file has them: where every entry names a registered kind, the keys of these kinds are enough.
            A file without any needs `ExperimentFile` alone.
    """
    each: Any = observation_type(_kinds(measurements))
    return create_model(
        "ExperimentFile", __base__=ExperimentFile, __doc__=ExperimentFile.__doc__, measurements=(dict[Name, each], {})
    )


def _kinds(measurements: object) -> tuple[type[Instrument], ...]:
    """Two at least, so that they are always told apart in the same way."""
    entries = measurements.values() if isinstance(measurements, dict) else ()
    named = [each.get("instrument") if isinstance(each, dict) else None for each in entries]
    if not named or not all(isinstance(name, str) and name in KINDS for name in named):
        return tuple(KINDS.values())
    others = [name for name in KINDS if name not in named][: max(0, 2 - len(set(named)))]
    return tuple(kind for name, kind in KINDS.items() if name in named or name in others)
