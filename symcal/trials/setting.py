"""What is built once of a study, for each set of instruments: models, functions, and what all trials share."""

from __future__ import annotations

import pickle
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.kernels import BatchFunction, batch_function
from symcal.kernels.path import kernels_by
from symcal.model.assembled import Assembled, readings_kernel
from symcal.model.measurement import Measurement
from symcal.model.model import Model, build_model
from symcal.planning.area import WorkingArea
from symcal.trials.description import Cell, Description
from symcal.trials.machine import kernels_of
from symcal.trials.poses import PoseSource, pose_source

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Setting:
    """One set of instruments.

    model: what is identified; true_model: of the robot that is measured, with the joint terms that the other one lacks.
    readings: (q, x, setup) -> z of the true robot. held_out: (q, x, setup) -> the measured points in world, shape
    (3 k,), mm, of the identified robot; held_out_true: of the true one. nominal: these of the nominal robot at the test
    poses, shape (T, 3 k). slopes: (q, x, setup) -> J of these points by the errors, shape (3 k, n).
    written_out: whether a pose's readings are plain expressions, everywhere to be had: no contacts, no limits of view.
    named: the parameters whose intervals are judged: of links and joint terms, which mean the same in every trial;
    judged, judged_true: their places in both models.
    """

    model: Model
    true_model: Model
    readings: BatchFunction | Assembled
    held_out: BatchFunction
    held_out_true: BatchFunction
    nominal: Array
    slopes: BatchFunction
    random: PoseSource
    written_out: bool
    named: tuple[str, ...]
    judged: NDArray[np.intp]
    judged_true: NDArray[np.intp]

    def sigma(self, cell: Cell) -> dict[str, float]:
        """Standard deviation of the noise of every group, mm, rad and px."""
        noise = cell.noise
        return {
            group.name: noise.sigma(noise.size(group.observation, group.quantity))
            for group in self.model.measurement.groups
        }

    def truth(self, description: Description, cell: Cell, drawn: Array | None) -> Array:
        """Errors of the true robot, shape (n,), of one trial, or (R, n) of several.

        Args:
            drawn: standard normal numbers, one or (R, ...) for each of the description's `spread`; None: as given.
        """
        names = self.true_model.parameters.names
        links = self.true_model.robot.parameters
        own = {name: value for name, value in description.truth.items() if name in names}
        x = self.true_model.parameters.vector(own)
        scaled = np.array([cell.size if name in links else 1.0 for name in names])
        if drawn is None:
            return np.asarray(x * scaled)
        x = np.tile(x, (*drawn.shape[:-1], 1))
        for i, (name, spread) in enumerate(description.spread.items()):
            if name in names:
                x[..., self.true_model.parameters.index(name)] = spread * drawn[..., i]
        return np.asarray(x * scaled)


def build_setting(description: Description, task: int) -> Setting:
    """Build and compile for one of the description's tasks.

    Raises:
        RefusedError: its instruments fix no point of the robot, or do not say where the world is.
    """
    with kernels_by(kernels_of(description.portable)):
        model = build_model(description.robot, description.tasks[task])
        true_model = model
        if description.terms:
            robot = replace(description.robot, terms=(*description.robot.terms, *description.terms))
            true_model = build_model(robot, model.task)
        insist_on_points(model)
        measurement = model.measurement
        held_out = _points(measurement)
        nominal = held_out(description.test, np.zeros(len(model.parameters)), model.setup.vector)[0]
        parts = true_model.measurement.parts
        return Setting(
            model,
            true_model,
            readings_kernel(true_model.measurement, None),
            held_out,
            held_out if true_model is model else _points(true_model.measurement),
            nominal,
            _points(measurement, 1),
            pose_source(model, WorkingArea(description.lower, description.upper), description.view),
            all(part.contact is None and part.margins is None and part.staged is None for part in parts),
            model.kinematic,
            model.parameters.indices(model.kinematic),
            true_model.parameters.indices(model.kinematic),
        )


def insist_on_points(model: Model) -> None:
    """A study judges positions in world.

    Raises:
        RefusedError: there are none.
    """
    names = ", ".join(o.name for o in model.task.observations)
    if model.measurement.points.size1_out(0) == 0:
        raise RefusedError(f"a study judges positions of the robot's points, and {names} measures none")
    if model.measurement.adrift:
        raise RefusedError(
            f"nothing but {names} says where the world is, and errors after an alignment are no study's yet: place "
            "an instrument or a target, or say 'base: known'"
        )


def _points(measurement: Measurement, output: int = 0) -> BatchFunction:
    """The points without their slopes, or these (1) alone."""
    whole = measurement.points
    given = whole.sx_in()
    name = ("held_out", "held_out_slopes")[output]
    return batch_function(ca.Function(name, given, [whole(*given)[output]], whole.name_in(), ["p"]))


_built: OrderedDict[tuple[str, int], Setting] = OrderedDict()
_unpacked: OrderedDict[str, Description] = OrderedDict()
_lock = threading.RLock()
_KEPT = 8


def description_of(digest: str, data: bytes) -> Description:
    """The description in these bytes, unpacked once in a process."""
    with _lock:
        if digest not in _unpacked:
            _unpacked[digest] = replace(pickle.loads(data), digest=digest)
            while len(_unpacked) > _KEPT:
                _unpacked.popitem(last=False)
        return _unpacked[digest]


def setting_of(description: Description, task: int) -> Setting:
    """The setting of a task, built once in a process."""
    key = (description.digest, task)
    with _lock:
        if key not in _built:
            _built[key] = build_setting(description, task)
            while len(_built) > max(_KEPT, len(description.tasks)):
                _built.popitem(last=False)
        return _built[key]
