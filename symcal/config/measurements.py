"""What an experiment file may say of instruments and targets: `measurements`, `targets`, and `measurement` in short.

Numbers here are still in the file's units; `symcal.config.observations` converts them.
"""

from functools import lru_cache, partial
from typing import Annotated, Any, Literal, Self, Union

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    WithJsonSchema,
    create_model,
    model_validator,
)
from pydantic_core import PydanticCustomError, PydanticKnownError

from symcal.config.data_sources import SourceConfig
from symcal.config.noise import KnownNoise, Positive
from symcal.config.plan import PlacementConfig
from symcal.documents.document import Strict
from symcal.instruments import KINDS, Instrument
from symcal.robot.schema import Frame

Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
Name = Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z][\w-]*$")]

RESERVED = ("base", "tool", "flange", "world")
"""Names that are the robot's own."""


def _registered(name: str) -> str:
    if name not in KINDS:
        raise PydanticKnownError("literal_error", {"expected": ", ".join(map(repr, KINDS))})
    return name


KindName = Annotated[str, AfterValidator(_registered), WithJsonSchema({"enum": list(KINDS), "type": "string"})]
"""The name of a registered kind of instrument."""


def word_or_given(value: object) -> str:
    """Which branch of a union is meant, so that a mistake is explained for that one."""
    return "word" if isinstance(value, str) else "given"


class MeasurementConfig(Strict):
    """What is measured, in short: one instrument on world that reads the robot's tool.

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
    noise: KnownNoise = {}
    camera: str | None = None
    target: str | None = None
    camera_pose: PlacementConfig | None = None

    @property
    def is_camera(self) -> bool:
        return KINDS[self.type].is_camera

    @model_validator(mode="before")
    @classmethod
    def _unknown_by_default(cls, data: Any) -> Any:
        kind = KINDS.get(str(data.get("type"))) if isinstance(data, dict) else None
        if kind is not None and kind.is_camera and "estimate" not in data:
            return data | {"estimate": ["tool", "camera", "intrinsics"]}
        return data

    @model_validator(mode="after")
    def _scene(self) -> Self:
        given = [name for name in ("camera", "target", "camera_pose") if getattr(self, name) is not None]
        if self.is_camera and (self.camera is None or self.target is None):
            raise PydanticCustomError("scene", "a pixel measurement needs 'camera' and 'target', files of theirs")
        if not self.is_camera and given:
            raise PydanticCustomError("scene", "'{name}' belongs to pixel measurements", {"name": given[0]})
        if self.is_camera and self.points:
            raise PydanticCustomError("scene", "a pixel measurement has the points of its target: leave them out")
        return self


class PlaceConfig(Strict):
    """Where something stands: on world, base, flange, tool or a link (by its joint's name), at its origin, at a frame
    there, or at one that is to be found.

    near: a first guess of what is to be found. per: with `session`, one place for each session of the data.
    """

    on: str = "world"
    place: (
        Annotated[
            Annotated[Literal["unknown"], Tag("word")] | Annotated[Frame, Tag("given")], Discriminator(word_or_given)
        ]
        | None
    ) = None
    near: Frame | PlacementConfig | None = None
    per: Literal["session"] | None = None

    @property
    def to_be_found(self) -> bool:
        return self.place == "unknown"

    @model_validator(mode="after")
    def _unknown(self) -> Self:
        if self.near is not None and self.place != "unknown":
            raise PydanticCustomError("place", "'near' belongs to 'place: unknown'")
        if self.per is not None and not self.to_be_found:
            raise PydanticCustomError(
                "place", "'per: session' needs something unknown of which every session has its own"
            )
        return self


class NearConfig(Strict):
    """A point that is to be found, and a first guess of it."""

    near: Triple


def _which_point(value: object) -> str:
    return "word" if isinstance(value, str) else "guess" if isinstance(value, dict | NearConfig) else "given"


PointConfig = Annotated[
    Annotated[Literal["unknown"], Tag("word")] | Annotated[NearConfig, Tag("guess")] | Annotated[Triple, Tag("given")],
    Discriminator(_which_point),
]


class TargetConfig(PlaceConfig):
    """What is read: points and axes by name in a frame of its own, or that frame.

    file: a target.yaml with discs, for cameras. board: a printed board, as `charuco:12x9:30mm:22mm:DICT_4X4_100`.
    incidence: of these, largest angle between the normal and the ray to the camera; 60 degrees for discs and 75 for
    boards by default. seen: how many points a view must show for any of them to count, or `whole`; by default a quarter
    of a board whose corners have marks of their own, and the whole of any other.
    """

    on: str = "tool"
    points: dict[Name, PointConfig] = {}
    axes: dict[Name, Triple] = {}
    file: str | None = None
    board: str | None = None
    incidence: Positive | None = None
    seen: (
        Annotated[
            Annotated[Literal["whole"], Tag("word")] | Annotated[int, Field(ge=4), Tag("given")],
            Discriminator(word_or_given),
        ]
        | None
    ) = None

    @property
    def to_be_found(self) -> bool:
        return self.place == "unknown" or any(not isinstance(xyz, list) for xyz in self.points.values())

    @model_validator(mode="after")
    def _sensible(self) -> Self:
        if self.file is not None and (self.points or self.axes):
            raise PydanticCustomError("target", "give the points in 'file' or here, not both")
        if self.board is not None and (self.file is not None or self.points):
            raise PydanticCustomError("target", "a board has its own points: leave 'points' and 'file' out")
        for key in ("incidence", "seen"):
            if getattr(self, key) is not None and self.board is None and self.file is None:
                raise PydanticCustomError("target", "'{key}' belongs to a 'board' or a 'file' with discs", {"key": key})
        for name, axis in self.axes.items():
            if not any(axis):
                raise PydanticCustomError("target", "the axis '{name}' cannot be the zero vector", {"name": name})
        return self


class NoiseConfig(Strict):
    """per: `axis` for a noise of every axis of the instrument's own frame."""

    per: Literal["axis"] | None = None

    def sizes(self) -> dict[str, float]:
        return {name: value for name, value in self.model_dump(exclude={"per"}).items() if value is not None}


class ObservationConfig(Strict):
    """An instrument that reads a target, with the keys of its kind beside these.

    at: where it stands, or the name of another entry of `measurements`, if it is at the same place. target: its name
    under `targets`, or what it is; with a value also the name of another entry, whose place is then what is read.
    reports: whose pose the data hold, where whole frames are read. session: poses of other sessions are other postures,
    whatever they are called. value: what would be read between two things that do not move against each other, known:
    a number for each column.
    """

    instrument: str
    at: Annotated[Annotated[str, Tag("word")] | Annotated[PlaceConfig, Tag("given")], Discriminator(word_or_given)] = (
        PlaceConfig.model_construct()
    )
    target: Annotated[
        Annotated[str, Tag("word")] | Annotated[TargetConfig, Tag("given")], Discriminator(word_or_given)
    ] = TargetConfig.model_construct()
    reports: Literal["target", "instrument"] = "target"
    session: str = ""
    noise: NoiseConfig = NoiseConfig.model_construct()
    data: SourceConfig | None = None
    value: float | list[float] | None = None

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.value is not None and self.data is not None:
            raise PydanticCustomError("value", "a known 'value' has no 'data'")
        return self


def _named(quantity: str, noise: object) -> object:
    """A noise that is one number, as that of the only quantity."""
    return {quantity: noise} if isinstance(noise, int | float) and not isinstance(noise, bool) else noise


def _of_kind(kind: type[Instrument]) -> type[ObservationConfig]:
    """The keys of an observation by a kind of instrument."""
    sizes: dict[str, Any] = {q.noise: (Positive | None, None) for q in kind().quantities}
    noise: Any = create_model(f"{kind.name}_noise", __base__=NoiseConfig, **sizes)
    either = noise
    if len(sizes) == 1:  # one number will do
        named = BeforeValidator(partial(_named, next(iter(sizes))), json_schema_input_type=float | noise)
        either = Annotated[noise, named]
    tag: dict[str, Any] = {"instrument": (Literal[kind.name], ...), "noise": (either, noise.model_construct())}
    own: dict[str, Any] = {name: (field.annotation, field) for name, field in kind.Config.model_fields.items()}
    return create_model(kind.name, __base__=ObservationConfig, __doc__=kind.Config.__doc__, **tag, **own)


@lru_cache(maxsize=8)
def observation_type(kinds: tuple[type[Instrument], ...]) -> Any:
    """The union over kinds, told apart by `instrument`."""
    return Annotated[Union[tuple(_of_kind(kind) for kind in kinds)], Field(discriminator="instrument")]  # noqa: UP007
