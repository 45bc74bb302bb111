"""The symbolic model of a task, compiled."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.kernels import BatchFunction, batch_function
from symcal.kinematics import chain, forward
from symcal.model.assembled import Assembled, RowKernel, errors_kernel, rows_kernel, slopes_kernel
from symcal.model.measurement import Measurement, Setup
from symcal.model.observe import observe
from symcal.model.symbols import numbers_of, places_of
from symcal.model.task import Task
from symcal.parameters import ParameterSet, zero_name
from symcal.robot.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Model:
    """The compiled measurement model of a task; made once, used for every fit.

    residuals: one per observation, see `symcal.model.measurement.Part`.
    """

    task: Task
    robot: Robot
    measurement: Measurement
    residuals: tuple[RowKernel, ...]
    accuracy: BatchFunction | Assembled
    jacobian: BatchFunction | Assembled
    flange: BatchFunction
    setup: Setup
    points: BatchFunction

    @property
    def parameters(self) -> ParameterSet:
        return self.measurement.parameters

    @property
    def residual(self) -> RowKernel:
        """Of the only observation."""
        (only,) = self.residuals
        return only

    @property
    def kinematic(self) -> tuple[str, ...]:
        """Parameters of links and joint terms that may be identified."""
        return tuple(name for name in self.robot.parameters if name not in self.task.fix)

    @property
    def offsets(self) -> tuple[str, ...]:
        """Zero offsets of the joints."""
        wanted = {zero_name(j.revolute, i) for i, j in enumerate(self.robot.joints, start=1)}
        return tuple(name for name in self.kinematic if name in wanted)

    @property
    def placement(self) -> tuple[str, ...]:
        """Parameters of frames, points and instruments that are estimated."""
        links = self.robot.parameters
        return tuple(name for name in self.parameters.names if name not in links and name not in self.task.fix)

    @property
    def frames(self) -> tuple[str, ...]:
        """The placement without the numbers of a camera, which come from its calibration."""
        calibrated = {
            item.name
            for o in self.task.observations
            if o.instrument.camera is not None
            for item in o.instrument.unknowns(o.prefix)[0]
        }
        return tuple(name for name in self.placement if name not in calibrated)

    def moved(self, setup: Setup, x: Array) -> Setup:
        """A setup with errors carried out, see `Setup.moved`."""
        return setup.moved(self.parameters.mapping(x), self.measurement.points_called)


@dataclass(frozen=True, slots=True)
class State:
    """A model with values for everything in it: what is needed to predict a measurement.

    unplaced: parameters of places and points that no training pose tells anything of: they are fitted to the poses that
    a state is judged by, with the robot held.
    """

    model: Model
    setup: Setup
    x: Array
    unplaced: tuple[str, ...] = ()


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
    measurement = observe(chain(robot, parameters, conditions=True), *task.observations, values=task.values)
    measurement = replace(measurement, chain=symbolic)
    return Model(
        task=task,
        robot=robot,
        measurement=measurement,
        residuals=tuple(rows_kernel(part) for part in measurement.parts),
        accuracy=errors_kernel(measurement),
        jacobian=slopes_kernel(measurement),
        flange=batch_function(forward(symbolic), evaluations=0),
        setup=nominal_setup(robot, task),
        points=batch_function(measurement.points, evaluations=0),
    )


def nominal_setup(robot: Robot, task: Task) -> Setup:
    """Where things nominally are, or are guessed to be."""
    points = {
        o.target.qualified(name): xyz
        for o in task.everything
        if not o.target.rigid
        for name, xyz in zip(o.target.points, o.target.nominal, strict=True)
    }
    on_tool = [o.target for o in task.observations if o.target.at.on == "tool" and o.target.at.frame is None]
    mounts = [target.marks.mount for target in on_tool if target.marks is not None]
    tool = next((mount for mount in mounts if mount is not None), robot.tool)
    return Setup(
        robot.base,
        tool,
        np.array(list(points.values())).reshape(-1, 3),
        {name: place.nominal for name, place in places_of(task.everything).items()},
        numbers_of(task.everything),
        robot.conditions,
    )
