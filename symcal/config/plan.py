"""What the section `plan` of an experiment file may say: its keys, their types, their defaults.

Numbers here are still in the file's units; `symcal.planning.plan_problem` converts them.
"""

from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from symcal.camera.files import Distortion, Intrinsics, Lens, Triangle
from symcal.config.counts import MOST, Count
from symcal.config.noise import KnownNoise
from symcal.documents.document import Strict
from symcal.robot.schema import Frame
from symcal.spatial import look_at

Array = NDArray[np.float64]

MethodName = Literal["certified", "combined", "exchange", "refine", "genetic", "random"]
CriterionName = Literal["D", "A", "E", "cond", "O1", "O2", "O3", "O4", "O5", "I", "G", "J"]


def _file_or_given(value: object) -> str:
    """Which branch of a union is meant, so that a mistake is explained for that one."""
    return "file" if isinstance(value, str) else "given"


def _rising(pair: list[float]) -> list[float]:
    if not pair[0] < pair[1]:
        raise PydanticCustomError("range", "a range is [lower, upper] with lower < upper")
    return pair


_Positive = Annotated[float, Field(gt=0)]
_NotNegative = Annotated[float, Field(ge=0)]
_Share = Annotated[float, Field(gt=0, le=1)]
_Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
_Pair = Annotated[list[float], Field(min_length=2, max_length=2), AfterValidator(_rising)]


class AreaRegion(Strict):
    """Where accuracy matters: ranges of the readings by joint name; those of the plan elsewhere."""

    type: Literal["area"]
    area: dict[str, _Pair] = {}


class BoxRegion(Strict):
    """Where accuracy matters: poses of the working area whose tool points lie in a box, in world."""

    type: Literal["box"]
    lower: _Triple
    upper: _Triple


class FileRegion(Strict):
    """Where accuracy matters: the poses of a CSV file."""

    type: Literal["csv"]
    file: str


class Margins(Strict):
    """Kept away from each joint limit: revolute joints by an angle, prismatic ones by a length."""

    angle: _NotNegative = 0.0
    length: _NotNegative = 0.0


class PlacementConfig(Strict):
    """Where the camera is in world: from a position looking at a point, or as a frame (z along the view, y down)."""

    position: _Triple | None = None
    look_at: _Triple | None = None
    frame: Frame | None = None

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        looking = self.position is not None and self.look_at is not None
        partly = self.position is not None or self.look_at is not None
        if looking == (self.frame is not None) or (partly and not looking):
            raise PydanticCustomError("placement", "give 'position' and 'look_at', or a 'frame'")
        return self

    def matrix(self, length: float, angle: float) -> Array:
        """T_world_camera, shape (4, 4), mm.

        Args:
            length, angle: mm and rad per unit of the file.
        Raises:
            InputError: a direction of view that is none.
        """
        if self.frame is not None:
            return self.frame.matrix(length, angle)
        return look_at(np.array(self.position) * length, np.array(self.look_at) * length)


class TargetShape(Strict):
    """The target on the tool: an equilateral `triangle` or named `points`, discs of one radius.

    mount: the target in the tool frame; discs face along its normal, z.
    """

    disc_radius: _Positive
    triangle: Triangle | None = None
    points: dict[str, _Triple] | None = None
    mount: Frame = Frame.model_construct()

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.triangle is None) == (self.points is None):
            raise PydanticCustomError("target", "a target is a 'triangle' (side) or named 'points': give one")
        return self


class CameraConstraint(Strict):
    """A pose is measured only if a fixed camera sees the whole target well enough.

    file: a camera.yaml; or width, height and `intrinsics` (px) or `lens`. margin_px: of every disc from the border of
    the image. depth: range of the discs' distance along the optical axis. incidence: largest angle between the target's
    normal and the ray to the camera; 60 degrees by default.
    """

    file: str | None = None
    width: Count | None = None
    height: Count | None = None
    intrinsics: Intrinsics | None = None
    lens: Lens | None = None
    distortion: Distortion = Distortion.model_construct()
    placement: PlacementConfig
    target: Annotated[Annotated[str, Tag("file")] | Annotated[TargetShape, Tag("given")], Discriminator(_file_or_given)]
    margin_px: _NotNegative = 0.0
    depth: _Pair | None = None
    incidence: _Positive | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        inline = self.width is not None and self.height is not None and (self.intrinsics is None) != (self.lens is None)
        touched = any(v is not None for v in (self.width, self.height, self.intrinsics, self.lens))
        if touched == (self.file is not None) or (touched and not inline):
            raise PydanticCustomError(
                "camera", "give 'file' (a camera.yaml), or 'width', 'height' and one of 'intrinsics' and 'lens'"
            )
        return self


class ViewLimits(Strict):
    """What the measurement's own camera can measure: as of a `CameraConstraint`.

    whole: boards that count in part, too, are to be seen as a whole.
    """

    margin_px: _NotNegative = 30.0
    depth: _Pair | None = None
    incidence: _Positive | None = None
    whole: bool = False


class KeepOutBox(Strict):
    """A box in world that no link may enter: its centre as a frame, its edges; margin: the arm's own thickness."""

    name: str
    xyz: _Triple
    rpy: _Triple = [0.0, 0.0, 0.0]
    size: Annotated[list[_Positive], Field(min_length=3, max_length=3)]
    margin: _NotNegative = 0.0
    first_link: Count = 1


class KeepOutPlane(Strict):
    """A plane in world, such as a table: all links stay on the side that its normal points to."""

    name: str
    point: _Triple
    normal: _Triple
    margin: _NotNegative = 0.0
    first_link: Count = 1


class CoverageConfig(Strict):
    """Cells in which the plan must have poses: of joint ranges by joint name, or of the tool's position (x, y, z).

    share: of the cells that poses can be in.
    """

    joints: dict[str, Count] | None = None
    position: Annotated[list[Count], Field(min_length=3, max_length=3)] | None = None
    share: _Share = 1.0

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.joints is None) == (self.position is None):
            raise PydanticCustomError("coverage", "give cells by 'joints' or of the 'position'")
        return self


class Constraints(Strict):
    """What a pose must satisfy to be measured, beyond the working area; `view` is about pixel measurements."""

    camera: CameraConstraint | None = None
    view: ViewLimits = ViewLimits.model_construct()
    keep_out: list[KeepOutBox] = []
    planes: list[KeepOutPlane] = []
    coverage: CoverageConfig | None = None


class FitnessWeights(Strict):
    """c1, c2 and c3 of the paper's eq. 12: per unit of observability, per rad, per px^2; c3 < 0 wants a large image."""

    observability: float = 1.0
    angle: float = 0.0
    area: float = 0.0


class GeneticConfig(Strict):
    """The genetic algorithm.

    fitness: minus the plan's own `criterion`; its condition number whitened by the area (`condition`); or the paper's
    eq. 12 (`paper`), whose `conditioning` is of every pose or of all stacked. Camera terms need a camera.
    """

    coding: Literal["binary", "gray", "real"] = "binary"
    population: Annotated[int, Field(ge=4, le=MOST)] = 200
    generations: Annotated[int, Field(ge=0, le=MOST)] = 200
    bits: Annotated[int, Field(ge=1, le=52)] = 8
    fitness: Literal["criterion", "condition", "paper"] = "criterion"
    conditioning: Literal["per_pose", "stacked"] = "stacked"
    weights: FitnessWeights = FitnessWeights.model_construct()


class PromiseConfig(Strict):
    """What is foretold. counts: numbers of poses (chosen when empty); accuracy: wanted rms position errors.

    figure: the error over the region that is meant: its mean or its worst pose. random: random plans per number.
    """

    counts: list[Count] = []
    accuracy: list[_Positive] = []
    figure: Literal["mean", "worst"] = "mean"
    random: Annotated[int, Field(ge=1, le=MOST)] = 100


class PlanConfig(Strict):
    """Which poses to measure.

    method: `certified` unless named; simulated data of a run without a method are taken at random poses.
    criterion: D unless named; J, which also guards against errors that the model lacks (of the size `unmodelled`, in
    units of the noise), for candidates. area: ranges of the readings by joint name; the joint limits elsewhere.
    region: where accuracy matters. start: joint readings where the robot begins. speeds: by joint name, instead of the
    robot file's. required: poses that the plan must have, as lists of readings or a CSV file. candidates: a CSV file
    of poses (or measurements) to choose from. distance: between any two poses, in units of the working area.
    random: random plans to compare with. prove: prove how good the plan is, instead of searching for better ones, where
    that is possible. compare: further methods whose efficiency over time is reported.
    sample: poses that stand for the feasible set. among: choose from any pose of the `area`, or from the `sample`
    alone, which is quick where information is costly; nothing is then foretold of other numbers of poses.
    instruments: sets of them, by their names, that are compared at the plan's poses; each alone and all together unless
    named.
    """

    method: MethodName | None = None
    criterion: CriterionName | None = None
    unmodelled: _NotNegative | None = None
    poses: Count = 40
    area: dict[str, Annotated[list[float], Field(min_length=2, max_length=2)]] = {}
    noise: KnownNoise = {}
    instruments: list[list[str]] = []
    region: Annotated[AreaRegion | BoxRegion | FileRegion, Field(discriminator="type")] | None = None
    start: list[float] | None = None
    speeds: dict[str, _Positive] = {}
    required: Annotated[
        Annotated[str, Tag("file")] | Annotated[list[list[float]], Tag("given")], Discriminator(_file_or_given)
    ] = []
    candidates: str | None = None
    distance: _NotNegative = 0.0
    margins: Margins = Margins.model_construct()
    constraints: Constraints = Constraints.model_construct()
    genetic: GeneticConfig = GeneticConfig.model_construct()
    random: Annotated[int, Field(ge=0, le=MOST)] = 200
    prove: bool = False
    compare: list[MethodName] = []
    promise: PromiseConfig = PromiseConfig.model_construct()
    sample: Annotated[int, Field(ge=100, le=MOST)] = 5000
    among: Literal["area", "sample"] = "area"
