"""What `symcal check` says: the model in numbers, where it stands at zero, and what a measurement could identify."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.fit.identifiability import Identifiability, analyse
from symcal.kernels import batch_function
from symcal.kinematics import chain, forward, frame_vector
from symcal.model.model import Model, Task, build_model
from symcal.model.parameter_set import parameter_set
from symcal.parameters import point_names
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

_PARALLEL = np.deg2rad(5.0)
_SAMPLE = 300  # poses: many more than parameters, so that the rank is the model's and not the sample's
_FREE_RANGE = {True: np.pi, False: 500.0}  # half range for joints without limits, rad and mm


@dataclass(frozen=True, slots=True)
class Check:
    """pose_at_zero: T_world_tool with all readings zero, shape (4, 4), mm.

    Seen: numerical identifiability per measurement kind.
    """

    pose_at_zero: Array
    seen: dict[str, Identifiability]
    notes: tuple[str, ...]


def check_robot(robot: Robot) -> Check:
    """A robot measured with everything known, and with base and tool unknown."""
    tasks = {
        "position of the tool": Task("position"),
        "position, base and tool point unknown": Task("position", frozenset({"base", "tool"})),
        "pose of the tool": Task("pose"),
        "pose, base and tool unknown": Task("pose", frozenset({"base", "tool"})),
    }
    return Check(
        pose_at_zero(robot),
        {name: potential(build_model(robot, task)) for name, task in tasks.items()},
        parallel_axes(robot),
    )


def check_model(model: Model) -> Check:
    """The measurement of an experiment."""
    task = model.task
    unknown = f", {' and '.join(sorted(task.estimate))} unknown" if task.estimate else ""
    return Check(pose_at_zero(model.robot), {f"{task.kind}{unknown}": potential(model)}, parallel_axes(model.robot))


def pose_at_zero(robot: Robot) -> Array:
    """T_world_tool with all joint readings at zero, shape (4, 4), mm."""
    kernel = batch_function(forward(chain(robot, parameter_set(robot))), evaluations=0)
    pose, _, _ = kernel(np.zeros((1, robot.dof)), np.zeros(len(robot.parameters)), frame_vector(robot.base, robot.tool))
    return np.asarray(pose[0])


def potential(model: Model) -> Identifiability:
    """What noise-free measurements over the whole joint ranges could see (numerical rank)."""
    rng = np.random.default_rng(0)
    ranges = [
        (j.lower, j.upper) if np.isfinite(j.upper - j.lower) else (-_FREE_RANGE[j.revolute], _FREE_RANGE[j.revolute])
        for j in model.robot.joints
    ]
    lower, upper = np.array(ranges).T
    q = rng.uniform(lower, upper, (_SAMPLE, len(lower)))
    (jacobian,) = model.jacobian(q, _somewhere(model, rng), model.setup.vector)
    # orientations weigh like a point at 200 mm, so that the numerical rank does not depend on units
    weight = model.measurement.per_component({"position": 1.0, "orientation": 200.0, "image": 1.0})
    free = (*model.kinematic, *model.placement)
    stacked = (jacobian * weight[None, :, None]).reshape(-1, len(model.parameters))
    return analyse(stacked, model.parameters, free, noise_known=False)


def _somewhere(model: Model, rng: np.random.Generator) -> Array:
    """Zero errors, shape (n,), but for tool points without coordinates: all at the flange they would see too little."""
    blank = zip(model.measurement.point_names, model.setup.points, strict=False)
    unplaced = [c for name, point in blank if not point.any() for c in point_names(name)]
    if model.task.tool != "points":
        unplaced = []
    return model.parameters.vector({name: float(rng.uniform(50, 150)) for name in unplaced})


def parallel_axes(robot: Robot) -> tuple[str, ...]:
    """Neighbouring axes that are (nearly) parallel without beta: their misalignment cannot be told ([Hayati1985])."""
    notes = []
    for i in range(1, robot.dof):
        link = robot.links[i - 1] if robot.convention == "standard" else robot.links[i]
        number = i if robot.convention == "standard" else i + 1
        if abs(np.sin(link.parameters.get("alpha", 0.0))) < np.sin(_PARALLEL) and "beta" not in link.parameters:
            names = f"'{robot.joints[i - 1].name}' and '{robot.joints[i].name}'"
            notes.append(
                f"the axes of {names} are nearly parallel and link {number} has no beta: a misalignment about y "
                f"cannot be "
                f"represented; list 'beta: 0' in link {number}"
            )
    return tuple(notes)
