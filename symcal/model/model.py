"""The symbolic model of a task, compiled."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.kernels import BatchFunction, batch_function
from symcal.kernels.path import Choice, Kind, choice_in_force, chosen_kind
from symcal.kinematics import chain, forward, function, pose_of
from symcal.model.assembled import Assembled, RowKernel, errors_kernel, rows_kernel, slopes_kernel
from symcal.model.content import Content, NoContentError, content
from symcal.model.measurement import Measurement, Setup
from symcal.model.observe import observe
from symcal.model.symbols import numbers_of, places_of
from symcal.model.task import Task
from symcal.parameters import ParameterSet, zero_name
from symcal.robot.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Kernels:
    """What a measurement needs at many postures, each compiled when it is first asked for: an identification needs few.

    choice: what runs them, see `symcal.kernels.path.chosen_kind`. residuals: one per observation, see
    `symcal.model.measurement.Part`.
    """

    measurement: Measurement
    choice: Choice = "auto"
    _poses: dict[str, BatchFunction] = field(default_factory=dict, repr=False)
    _accuracy: dict[Kind, BatchFunction | Assembled] = field(default_factory=dict, repr=False)

    @cached_property
    def residuals(self) -> tuple[RowKernel, ...]:
        return tuple(rows_kernel(part, self.choice) for part in self.measurement.parts)

    def accuracy_for(self, poses: int) -> BatchFunction | Assembled:
        """What is judged, for so many poses: it follows from their number which way is worth it."""
        kind = chosen_kind(self.choice, poses)
        if kind not in self._accuracy:
            self._accuracy[kind] = errors_kernel(self.measurement, poses, self.choice)
        return self._accuracy[kind]

    @cached_property
    def jacobian(self) -> BatchFunction | Assembled:
        return slopes_kernel(self.measurement, self.choice)

    @cached_property
    def flange(self) -> BatchFunction:
        return batch_function(forward(self.measurement.chain), backend=self.choice, evaluations=0)

    @cached_property
    def points(self) -> BatchFunction:
        return batch_function(self.measurement.points, backend=self.choice, evaluations=0)

    def pose(self, station: str) -> BatchFunction:
        """(q, x, frames) -> where a station of the chain is in world, shape (4, 4), mm."""
        if station not in self._poses:
            chain = self.measurement.chain
            state = {"q": chain.q, "x": chain.x, "frames": chain.frames}
            pose = function("pose", state, {"T": pose_of(chain.stations[station])})
            self._poses[station] = batch_function(pose, backend=self.choice, evaluations=0)
        return self._poses[station]


@dataclass(frozen=True, eq=False)
class Model:
    """The measurement model of a task; made once, used for every fit.

    setup: where things nominally are.
    """

    task: Task
    robot: Robot
    kernels: Kernels
    setup: Setup

    @property
    def measurement(self) -> Measurement:
        return self.kernels.measurement

    @property
    def residuals(self) -> tuple[RowKernel, ...]:
        """See `Kernels`."""
        return self.kernels.residuals

    @property
    def accuracy(self) -> BatchFunction | Assembled:
        """(q, x, setup, z) -> what is judged, see `Measurement.accuracy`."""
        return self.kernels.accuracy_for(0)

    @property
    def jacobian(self) -> BatchFunction | Assembled:
        """(q, x, setup) -> J at zero residual, see `Measurement.jacobian`."""
        return self.kernels.jacobian

    @property
    def flange(self) -> BatchFunction:
        """(q, x, frames) -> the tool's pose and Jacobians, see `symcal.kinematics.forward`."""
        return self.kernels.flange

    @property
    def points(self) -> BatchFunction:
        """(q, x, setup) -> what of the robot is measured, see `Measurement.points`."""
        return self.kernels.points

    @property
    def parameters(self) -> ParameterSet:
        return self.measurement.parameters

    @property
    def residual(self) -> RowKernel:
        """Of the only observation."""
        (only,) = self.residuals
        return only

    @cached_property
    def kinematic(self) -> tuple[str, ...]:
        """Parameters of links and joint terms that may be identified."""
        return tuple(name for name in self.robot.parameters if name not in self.task.fix)

    @cached_property
    def offsets(self) -> tuple[str, ...]:
        """Zero offsets of the joints."""
        wanted = {zero_name(j.revolute, i) for i, j in enumerate(self.robot.joints, start=1)}
        return tuple(name for name in self.kinematic if name in wanted)

    @cached_property
    def placement(self) -> tuple[str, ...]:
        """Parameters of frames, points and instruments that are estimated."""
        links = self.robot.parameters
        return tuple(name for name in self.parameters.names if name not in links and name not in self.task.fix)

    @cached_property
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


_MODELS = 16  # of different content that are kept: an identification with joint terms and a remainder needs six


@dataclass(frozen=True, slots=True)
class _Wanted:
    """A robot and a task, told apart by what they hold, and what is to run their kernels."""

    held: Content
    choice: Choice
    robot: Robot = field(compare=False, repr=False)
    task: Task = field(compare=False, repr=False)


def build_model(robot: Robot, task: Task) -> Model:
    """The symbolic model of a task; kernels are compiled when they are first asked for.

    Models of the same robot and task, by what these hold, share their expressions and kernels within a process, unless
    `_MODELS` others came in between, or other kernels are asked for.

    Raises:
        InputError: names in fix, scales or priors that the model does not have; parts that cannot be estimated
        together.

    Example:
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/ur5.yaml")
        >>> model = sc.build_model(robot, sc.Task.of("position"))
        >>> len(model.parameters)
        26
    """
    bare, choice = (replace(robot, record=None), task.without_data), choice_in_force()
    try:
        held = content(bare)
    except NoContentError:  # an instrument of one's own that does not say what it holds
        kernels = _kernels(*bare, choice)
    else:  # copied: whatever is done with the originals later changes nothing
        kernels = _kept(_Wanted(held, choice, *deepcopy(bare)))
    return Model(task, robot, kernels, nominal_setup(robot, task))


@lru_cache(maxsize=_MODELS)
def _kept(wanted: _Wanted) -> Kernels:
    return _kernels(wanted.robot, wanted.task, wanted.choice)


def _kernels(robot: Robot, task: Task, choice: Choice) -> Kernels:
    parameters = task.parameters(robot)
    for name in task.fix:
        if name not in parameters.names:
            raise InputError("no such parameter to fix", key="identification.fix", found=name, allowed=parameters.names)
    parameters = parameters.with_scales(task.scales).with_priors(task.priors)
    symbolic = chain(robot, parameters)
    under = chain(robot, parameters, conditions=True) if robot.conditions else symbolic
    return Kernels(replace(observe(under, *task.observations, values=task.values), chain=symbolic), choice)


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
