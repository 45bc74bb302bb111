"""What is measured on a robot and what is unknown of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import Camera
from symcal.camera.target import Target as Marks
from symcal.errors import InputError
from symcal.instruments import kind_named, seen_by
from symcal.instruments.protocol import Instrument
from symcal.model.observation import Observation, Place, Point, Target
from symcal.model.parameter_set import parameter_set
from symcal.model.soundness import insist_on_sense
from symcal.parameters import FRAME_AXES, JointPrior, Parameter, ParameterSet
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
CAMERA = "camera"
"""What the frame of the only camera is called."""
Unknown = Literal["base", "tool", "points", "camera", "intrinsics"]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A fixed camera, the target on the tool that it looks at, and where it roughly stands.

    T_world_camera: z along its view, y down, shape (4, 4), mm; None if that is to be found from the image points.
    """

    camera: Camera
    target: Marks
    T_world_camera: Array | None = None


@dataclass(frozen=True, slots=True)
class Task:
    """What is measured on a robot and what is to be estimated.

    observations: what reads postures; values: what is known between things that do not move against each other
    (`Observation.value`), wherever they stand in what is given. base, tool: whether the robot's own frames are unknown.
    fix: parameters to hold at nominal. scales, priors: by parameter name, mm or rad.

    Example:
        >>> import symcal as sc
        >>> task = sc.Task.of("position", {"base", "tool"})
        >>> len(task.observations)
        1
    """

    observations: tuple[Observation, ...]
    base: bool = False
    tool: bool = False
    fix: tuple[str, ...] = ()
    scales: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, float] = field(default_factory=dict)
    values: tuple[Observation, ...] = ()

    def __post_init__(self) -> None:
        given = (*self.observations, *self.values)
        kinds = [o.instrument.name for o in given]
        named = []
        for i, o in enumerate(given):
            own = kinds[i] if kinds.count(kinds[i]) == 1 else f"{kinds[i]}_{kinds[: i + 1].count(kinds[i])}"
            named.append(o if o.name else replace(o, name=own))
        object.__setattr__(self, "observations", tuple(o for o in named if o.value is None))
        object.__setattr__(self, "values", tuple(o for o in named if o.value is not None))

    @classmethod
    def of(
        cls,
        kind: str | Instrument,
        estimate: Iterable[Unknown] = (),
        points: Mapping[str, Point | None] | None = None,
        *,
        invert: bool = False,
        fix: tuple[str, ...] = (),
        scales: Mapping[str, float] | None = None,
        priors: Mapping[str, float] | None = None,
    ) -> Task:
        """One instrument, on world, that reads the robot's tool: the short form of files.

        Args:
            kind: of instrument, or its name. estimate: what of base, tool and points is unknown. points: in the tool's
                frame, mm, where points are read; the tool's origin, called P, when None.
            invert: the instrument is on the tool and reads world's frame (eye in hand).
        Raises:
            InputError: there is no such kind, or it cannot measure like this.
        """
        instrument = kind_named(kind)() if isinstance(kind, str) else kind
        unknown = frozenset(estimate)
        if instrument.camera is not None:
            raise InputError("a camera needs its target: see `pixels_task`", key="measurement")
        if unknown & {"camera", "intrinsics"}:
            part = sorted(unknown & {"camera", "intrinsics"})[0]
            raise InputError("only pixel measurements have a camera", key="measurement.estimate", found=part)
        reads = instrument.reads
        if reads != "points" and "points" in unknown:
            message = f"{instrument.name} measurements have no tool points to estimate"
            raise InputError(message, key="measurement.estimate")
        if invert and reads != "frame":
            raise InputError("only pose measurements can be inverted", key="measurement.invert")
        given = {"P": (0.0, 0.0, 0.0)} if points is None else dict(points)
        given = given if reads == "points" else {}
        for name, xyz in given.items():
            if "points" not in unknown and (xyz is None or np.shape(xyz) != (3,)):
                message = f"the point '{name}' needs x, y and z in mm; zeros will do where points are estimated"
                raise InputError(message, key="points", found=xyz)
        observation = Observation(
            instrument,
            instrument.name,
            at=Place("tool" if invert else "world"),
            target=Target(
                "world" if invert else "tool",
                Place("world" if invert else "tool"),
                given,
                {"z": (0.0, 0.0, 1.0)} if reads == "axes" else {},
                unknown="points" in unknown,
            ),
        )
        return cls((observation,), "base" in unknown, "tool" in unknown, fix, scales or {}, priors or {})

    @property
    def everything(self) -> tuple[Observation, ...]:
        """What reads postures, then what is known."""
        return (*self.observations, *self.values)

    @property
    def judged_by(self) -> tuple[Observation, ...]:
        """The observations whose errors judge: those that give points, else all that read the same as the first."""
        givers = tuple(o for o in self.observations if o.instrument.gives_point)
        first = self.observations[0].instrument
        alike = (first.error, first.error_words)
        return givers or tuple(o for o in self.observations if (o.instrument.error, o.instrument.error_words) == alike)

    @property
    def scene(self) -> Scene | None:
        """The fixed camera with its target, where that is all that measures and it is called so: the short form."""
        first = self.observations[0]
        camera, marks = first.instrument.camera, first.target.marks
        if len(self.observations) > 1 or camera is None or marks is None or first.at.moves or first.place != CAMERA:
            return None
        return Scene(camera, marks, first.at.frame)

    @property
    def tool_axes(self) -> Literal["frame", "position"] | None:
        """What of the tool is estimated. One point alone does not see the tool's orientation."""
        if not self.tool:
            return None
        points = set()
        for observation in self.observations:
            on_tool = observation.target.at.on == "tool"
            if observation.at.on == "tool" or (on_tool and observation.instrument.reads != "points"):
                return "frame"
            if on_tool:
                points |= {observation.target.qualified(name) for name in observation.target.points}
        return "position" if len(points) == 1 else "frame"

    def parameters(self, robot: Robot) -> ParameterSet:
        """All parameters of the task's model, with the robot's scales.

        Raises:
            InputError: what cannot be estimated together, or does not make sense together.
        """
        insist_on_sense(self.observations, self.values, base=self.base, tool=self.tool, robot=robot)
        places: dict[str, tuple[str, ...]] = {}
        own: dict[str, Parameter] = {}
        priors: dict[tuple[str, ...], JointPrior] = {}
        for o in self.everything:
            for name, axes in ((o.place, o.place_axes), (o.target.name, o.target_axes)):
                if axes:
                    found = places.get(name, ())
                    places[name] = tuple(a for a in FRAME_AXES if a in found or a in axes)
            items, together = o.instrument.unknowns(o.prefix)
            own |= {item.name: item for item in items}
            priors |= {prior.names: prior for prior in together}
        return parameter_set(
            robot,
            base=self.base,
            tool=self.tool_axes,
            points=dict.fromkeys(o.target.qualified(p) for o in self.everything for p in o.target.unknown_points),
            places=places,
            own=own.values(),
            priors=priors.values(),
        )

    @property
    def without_data(self) -> Task:
        """The same task without what its observations have read."""
        bare = (tuple(replace(o, data=None) for o in each) for each in (self.observations, self.values))
        observations, values = bare
        return replace(self, observations=observations, values=values)

    def observed(self, observations: Iterable[Observation]) -> Task:
        """The same task with other observations, and what is known of the things in them."""
        kept = tuple(observations)
        things = {name for o in kept for name in o.things}
        return replace(self, observations=kept, values=tuple(v for v in self.values if things.issuperset(v.things)))


def pixels_task(
    scene: Scene,
    estimate: Iterable[Unknown] = ("tool", "camera", "intrinsics"),
    *,
    fix: tuple[str, ...] = (),
    scales: Mapping[str, float] | None = None,
    priors: Mapping[str, float] | None = None,
) -> Task:
    """Identification from image points: by default mount, camera pose and, with their prior, intrinsics are unknown."""
    unknown, marks = frozenset(estimate), scene.target
    observation = Observation(
        seen_by(scene.camera, calibrate="intrinsics" in unknown),
        "pixels",
        at=Place("world", scene.T_world_camera, "camera" in unknown),
        target=Target("tool", Place("tool"), marks.by_name, marks=marks, unknown="points" in unknown),
        place_name=CAMERA,
        own_prefix="",
    )
    return Task((observation,), "base" in unknown, "tool" in unknown, fix, scales or {}, priors or {})
