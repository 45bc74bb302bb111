"""What is measured on a robot and what is unknown, and the symbolic model compiled for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal import measurements
from symcal.errors import InputError
from symcal.kernels import BatchFunction, batch_function
from symcal.kinematics import chain, forward
from symcal.measurements import Measurement, Setup
from symcal.parameters import ParameterSet, parameter_set
from symcal.robot import Robot
from symcal.rows import residual_kernel

Array = NDArray[np.float64]
Part = Literal["base", "tool", "points"]


@dataclass(frozen=True, slots=True)
class Task:
    """What is measured on a robot and what is to be estimated.

    kind: `position` or `pose`; invert: pose data are T_tool_world (eye in hand). estimate: parts whose place is
        unknown.
    points: tool points in the tool frame by name, mm (position); coordinates of points to be estimated may be anything.
    fix: parameters to hold at nominal. scales, priors: by parameter name, mm or rad.
    """

    kind: Literal["position", "pose"]
    estimate: frozenset[Part] = frozenset()
    points: Mapping[str, tuple[float, float, float]] = field(default_factory=lambda: {"P": (0.0, 0.0, 0.0)})
    invert: bool = False
    fix: tuple[str, ...] = ()
    scales: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, float] = field(default_factory=dict)

    @property
    def point_names(self) -> tuple[str, ...]:
        return tuple(self.points) if self.kind == "position" else ()

    @property
    def tool(self) -> Literal["frame", "position", "points"] | None:
        """What of the tool is estimated. One point alone does not see the tool's orientation."""
        if "points" in self.estimate:
            return "points"
        if "tool" in self.estimate:
            return "frame" if self.kind == "pose" or len(self.points) > 1 else "position"
        return None

    def parameters(self, robot: Robot) -> ParameterSet:
        """All parameters of the task's model, with the robot's scales.

        Raises:
            InputError: parts that cannot be estimated together, or that this kind of measurement does not have.
        """
        if {"points", "tool"} <= self.estimate:
            message = "'tool' and 'points' cannot both be estimated: moving the tool is moving all its points"
            raise InputError(message, key="measurement.estimate")
        if "points" in self.estimate and self.kind != "position":
            raise InputError("only position measurements have tool points to estimate", key="measurement.estimate")
        if self.invert and self.kind != "pose":
            raise InputError("only pose measurements can be inverted", key="measurement.invert")
        return parameter_set(
            robot,
            base="base" in self.estimate,
            tool=None if self.tool == "points" else self.tool,
            points=self.point_names if self.tool == "points" else (),
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
        wanted = {f"{'theta' if j.revolute else 'd'}_{i}" for i, j in enumerate(self.robot.joints, start=1)}
        return tuple(name for name in self.kinematic if name in wanted)

    @property
    def placement(self) -> tuple[str, ...]:
        """Parameters of base, tool and points that are estimated."""
        return tuple(
            name for name in self.parameters.names if name not in self.robot.parameters and name not in self.task.fix
        )


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
    parameters = parameters.with_scales(task.scales).with_priors(task.priors)
    symbolic = chain(robot, parameters)
    if task.kind == "position":
        measurement = measurements.position(symbolic, task.point_names)
        points = np.array(list(task.points.values()), dtype=float).reshape(-1, 3)
    else:
        measurement = measurements.pose(symbolic, invert=task.invert)
        points = np.zeros((0, 3))
    return Model(
        task=task,
        robot=robot,
        measurement=measurement,
        residual=residual_kernel(measurement),
        accuracy=batch_function(measurement.accuracy, evaluations=0),
        jacobian=batch_function(measurement.jacobian, evaluations=0),
        flange=batch_function(forward(symbolic), evaluations=0),
        setup=Setup(robot.base, robot.tool, points),
    )
