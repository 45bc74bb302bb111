"""What is measured on a robot and what is unknown, and the symbolic model compiled for it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import INTRINSIC_NAMES, Camera
from symcal.camera.target import Target
from symcal.errors import InputError
from symcal.instruments import Kind, Measurement, Setup, kind_named, observe
from symcal.kernels import BatchFunction, batch_function
from symcal.kinematics import chain, forward
from symcal.model.parameter_set import parameter_set
from symcal.parameters import ParameterSet, zero_name
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
Part = Literal["base", "tool", "points", "camera", "intrinsics"]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A fixed camera, the target on the tool that it looks at, and where it roughly stands.

    T_world_camera: z along its view, y down, shape (4, 4), mm; None if that is to be found from the image points.
    """

    camera: Camera
    target: Target
    T_world_camera: Array | None = None


@dataclass(frozen=True, slots=True)
class Task:
    """What is measured on a robot and what is to be estimated.

    kind: of instrument, by its name (`symcal.instruments.registry`); invert: pose data are T_tool_world (eye in hand).
    estimate: parts whose place is unknown.
    points: tool points in the tool frame by name, mm (position); coordinates of points to be estimated may be anything.
    scene: of `pixels` (see `pixels_task`): the tool is then the target's frame, and its points are the target's.
    fix: parameters to hold at nominal. scales, priors: by parameter name, mm or rad.
    """

    kind: str
    estimate: frozenset[Part] = frozenset()
    points: Mapping[str, tuple[float, float, float]] = field(default_factory=lambda: {"P": (0.0, 0.0, 0.0)})
    invert: bool = False
    fix: tuple[str, ...] = ()
    scales: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, float] = field(default_factory=dict)
    scene: Scene | None = None

    @property
    def point_names(self) -> tuple[str, ...]:
        return tuple(self.points) if self.instrument.reads_points else ()

    @property
    def instrument(self) -> Kind:
        """The kind of instrument.

        Raises:
            InputError: there is none of this name.
        """
        return kind_named(self.kind)

    @property
    def tool(self) -> Literal["frame", "position", "points"] | None:
        """What of the tool is estimated. One point alone does not see the tool's orientation."""
        if "points" in self.estimate:
            return "points"
        if "tool" in self.estimate:
            return "position" if len(self.point_names) == 1 else "frame"
        return None

    def parameters(self, robot: Robot) -> ParameterSet:
        """All parameters of the task's model, with the robot's scales.

        Raises:
            InputError: parts that cannot be estimated together, or that this kind of measurement does not have.
        """
        if {"points", "tool"} <= self.estimate:
            message = "'tool' and 'points' cannot both be estimated: moving the tool is moving all its points"
            raise InputError(message, key="measurement.estimate")
        if "points" in self.estimate and not self.instrument.reads_points:
            raise InputError(f"{self.kind} measurements have no tool points to estimate", key="measurement.estimate")
        for part in ("camera", "intrinsics"):
            if part in self.estimate and self.scene is None:
                raise InputError("only pixel measurements have a camera", key="measurement.estimate", found=part)
        if self.instrument.place and self.scene is None:
            raise InputError("pixel measurements need a camera and a target", key="measurement")
        if {"base", "camera"} <= self.estimate:
            message = "'base' and 'camera' cannot both be estimated: moving the robot is moving the camera"
            raise InputError(message, key="measurement.estimate")
        if self.invert and self.instrument.reads_points:
            raise InputError("only pose measurements can be inverted", key="measurement.invert")
        return parameter_set(
            robot,
            base="base" in self.estimate,
            tool=None if self.tool == "points" else self.tool,
            points=self.point_names if self.tool == "points" else (),
            camera="camera" in self.estimate,
            intrinsics=self.scene.camera if self.scene and "intrinsics" in self.estimate else None,
        )


def pixels_task(
    scene: Scene,
    estimate: Iterable[Part] = ("tool", "camera", "intrinsics"),
    *,
    fix: tuple[str, ...] = (),
    scales: Mapping[str, float] | None = None,
    priors: Mapping[str, float] | None = None,
) -> Task:
    """Identification from image points: by default mount, camera pose and, with their prior, intrinsics are unknown."""
    points = {
        name: (float(x), float(y), float(z))
        for name, (x, y, z) in zip(scene.target.names, scene.target.points, strict=True)
    }
    return Task(
        kind="pixels",
        estimate=frozenset(estimate),
        points=points,
        fix=fix,
        scales=scales or {},
        priors=priors or {},
        scene=scene,
    )


@dataclass(frozen=True, slots=True)
class Model:
    """The compiled measurement model of a task; made once, used for every fit."""

    task: Task
    robot: Robot
    measurement: Measurement
    residual: BatchFunction
    accuracy: BatchFunction
    jacobian: BatchFunction
    flange: BatchFunction
    setup: Setup
    points: BatchFunction

    @property
    def parameters(self) -> ParameterSet:
        return self.measurement.parameters

    @property
    def kinematic(self) -> tuple[str, ...]:
        """Link parameters that may be identified."""
        return tuple(name for name in self.robot.parameters if name not in self.task.fix)

    @property
    def offsets(self) -> tuple[str, ...]:
        """Zero offsets of the joints."""
        wanted = {zero_name(j.revolute, i) for i, j in enumerate(self.robot.joints, start=1)}
        return tuple(name for name in self.kinematic if name in wanted)

    @property
    def placement(self) -> tuple[str, ...]:
        """Parameters of base, tool, points and camera that are estimated."""
        return tuple(
            name for name in self.parameters.names if name not in self.robot.parameters and name not in self.task.fix
        )

    @property
    def frames(self) -> tuple[str, ...]:
        """The placement without the camera's intrinsics."""
        return tuple(name for name in self.placement if name not in INTRINSIC_NAMES)


@dataclass(frozen=True, slots=True)
class State:
    """A model with values for everything in it: what is needed to predict a measurement."""

    model: Model
    setup: Setup
    x: Array


def build_model(robot: Robot, task: Task) -> Model:
    """Build and compile the symbolic model of a task.

    Raises:
        InputError: names in fix, scales or priors that the model does not have; parts that cannot be estimated
        together.
    """
    parameters = task.parameters(robot)
    for name in task.fix:
        if name not in parameters.names:
            raise InputError("no such parameter to fix", key="identification.fix", found=name, allowed=parameters.names)
    for name in task.point_names:
        if np.shape(task.points[name]) != (3,):
            message = f"the point '{name}' needs x, y and z in mm; zeros will do where points are estimated"
            raise InputError(message, key="points", found=task.points[name])
    parameters = parameters.with_scales(task.scales).with_priors(task.priors)
    symbolic = chain(robot, parameters)
    points = np.array([task.points[name] for name in task.point_names], dtype=float).reshape(-1, 3)
    setup = Setup(robot.base, robot.tool, points)
    measurement = observe(symbolic, task.instrument, task.point_names, riding=task.invert)
    if task.scene is not None:
        setup = _scene_setup(setup, task.scene)
    return Model(
        task=task,
        robot=robot,
        measurement=measurement,
        residual=batch_function(measurement.residual),
        accuracy=batch_function(measurement.accuracy, evaluations=0),
        jacobian=batch_function(measurement.jacobian, evaluations=0),
        flange=batch_function(forward(symbolic), evaluations=0),
        setup=setup,
        points=batch_function(measurement.points, evaluations=0),
    )


def _scene_setup(setup: Setup, scene: Scene) -> Setup:
    tool = setup.tool if scene.target.mount is None else scene.target.mount
    camera = np.eye(4) if scene.T_world_camera is None else scene.T_world_camera
    return replace(setup, tool=tool, camera=camera, intrinsics=scene.camera.intrinsics)
