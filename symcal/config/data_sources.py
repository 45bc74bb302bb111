"""What an experiment file may say of where measurements are: files, images, recordings, pairs of poses."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from symcal.config.noise import Positive
from symcal.documents.document import Strict


class SplitConfig(Strict):
    """Which poses train and which test: labels of a column, or a random share."""

    column: str | None = None
    train: list[str] = ["train"]
    test: list[str] = ["test"]
    test_fraction: Annotated[float, Field(gt=0, lt=1)] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.column is not None and self.test_fraction is not None:
            raise PydanticCustomError("split", "give 'column' or 'test_fraction', not both")
        for label in self.train:
            if label in self.test:
                message = "the label '{label}' stands under 'train' and under 'test'"
                raise PydanticCustomError("split", message, {"label": label})
        return self


class FileData(Strict):
    """Measurements from a CSV, Excel or ODS file, or from several.

    file: its name, a pattern (`day*.csv`), or a list of both. sheet: of an Excel or ODS file, where more than one is
    not empty. columns: canonical name -> name in the file, or a list of names whose cells make one (`front/0`). where:
    cells of the rows that count, by column. session: `file` makes every file a session. delimiter, decimal: of CSV
    files; found out where they are not said.
    """

    source: Literal["file"]
    file: str | Annotated[list[str], Field(min_length=1)]
    sheet: str | None = None
    columns: dict[str, str | list[str]] = {}
    where: dict[str, str | int] = {}
    split: SplitConfig = SplitConfig.model_construct()
    delimiter: Literal[",", ";", "\t"] | None = None
    decimal: Literal[".", ","] | None = None
    session: Literal["file"] | None = None

    @property
    def listed(self) -> list[str]:
        return [self.file] if isinstance(self.file, str) else self.file


class ImagesData(Strict):
    """Measurements from images of a board or of discs, measured in the same run.

    files: images, or folders of them. joints: CSV file with a column `image` and the joint readings at which each was
    taken; `pose` and `split` if there are any.
    """

    source: Literal["images"]
    files: str | Annotated[list[str], Field(min_length=1)]
    joints: str
    split: SplitConfig = SplitConfig.model_construct()

    @property
    def listed(self) -> list[str]:
        return [self.files] if isinstance(self.files, str) else self.files


class RecordedData(Strict):
    """How joint readings and measurements that were recorded side by side are matched by time.

    match: `still` takes the means of both where the robot stands still; `nearest` takes every measurement with the
    joint readings nearest in time. tolerance_s: by which the clocks may differ. still_s: the shortest time that counts
    as standing still; settle_s of its beginning are left out. still_rad, still_mm: within which a reading stands still.
    time_shift_s: by which the measurements come late, where that is known.
    """

    match: Literal["still", "nearest"] = "still"
    tolerance_s: Positive = 0.02
    still_s: Positive = 0.5
    settle_s: Annotated[float, Field(ge=0)] = 0.2
    still_rad: Positive = 1e-3
    still_mm: Positive = 0.1
    time_shift_s: float = 0.0
    split: SplitConfig = SplitConfig.model_construct()


class BagData(RecordedData):
    """Measurements from a ROS 2 bag.

    file: the bag's folder, or its one file. joint_topic: of sensor_msgs/JointState; topic: of what was measured, of
    geometry_msgs PoseStamped, PoseWithCovarianceStamped, PointStamped or TransformStamped, nav_msgs/Odometry or
    tf2_msgs/TFMessage; where left out, the only ones that fit. frames: parent and child, of transforms. joint_names:
    those of the messages in the order of the robot's; by default the robot's own, or these with `_joint` behind.
    """

    source: Literal["bag"]
    file: str
    joint_topic: str | None = None
    topic: str | None = None
    frames: Annotated[list[str], Field(min_length=2, max_length=2)] | None = None
    joint_names: list[str] | None = None


class TrajectoryData(RecordedData):
    """Poses from a trajectory in the format of TUM or EuRoC. joints: CSV file of joint readings with a column `t_s`."""

    source: Literal["trajectory"]
    file: str
    joints: str


class PairsData(Strict):
    """Pairs of poses for hand-eye calibration, as easy_handeye2 or MoveIt save them.

    eye: where the camera is, for an easy_handeye2 file that does not say it. joints: CSV file of joint readings beside
    them, row by row, or joint states as MoveIt saves them; without it `robot: given_poses`, and frames alone.
    """

    source: Literal["pairs"]
    file: str
    eye: Literal["hand", "base"] | None = None
    joints: str | None = None
    split: SplitConfig = SplitConfig.model_construct()


TableData = FileData | BagData | TrajectoryData | PairsData
"""Sources of which a table of measurements is made."""
SourceConfig = Annotated[FileData | BagData | TrajectoryData | PairsData | ImagesData, Field(discriminator="source")]
