"""What `symcal check` says: the model in numbers, where it stands at zero, and what a measurement could identify."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.calibration.observation_facts import observation_facts, unknown_words
from symcal.data.conditions import condition_columns
from symcal.fit.identifiability import Identifiability, analyse, numerical_rank
from symcal.joints.payload import PAYLOAD
from symcal.kernels import batch_function
from symcal.kinematics import chain, forward, frame_vector
from symcal.model.contact import constraints, contact_postures, touched
from symcal.model.measurement import Setup
from symcal.model.model import Model, build_model
from symcal.model.observation import Place
from symcal.model.parameter_set import parameter_set
from symcal.model.symbols import places_of
from symcal.model.task import Task
from symcal.parameters import coordinate_names
from symcal.robot.given import is_given
from symcal.robot.robot import Robot
from symcal.spatial import transform
from symcal.words import in_short, listed

Array = NDArray[np.float64]

_PARALLEL = np.deg2rad(5.0)
_LOAD = 5.0  # kg
_SAMPLE = 300  # poses: many more than parameters, so that the rank is the model's and not the sample's


@dataclass(frozen=True, slots=True)
class Check:
    """pose_at_zero: T_world_tool with all readings zero, shape (4, 4), mm.

    Seen: numerical identifiability per measurement kind.
    """

    pose_at_zero: Array
    seen: dict[str, Identifiability]
    notes: tuple[str, ...]
    instruments: tuple[Added, ...] = ()

    def facts(self) -> dict[str, Any]:
        """Everything as plain data."""
        return {
            "T_world_tool_at_zero": self.pose_at_zero.tolist(),
            "seen": {
                name: {
                    "rank": seen.numerical_rank,
                    "parameters": list(seen.names),
                    "unseen": [direction.text for direction in seen.unseen()],
                }
                for name, seen in self.seen.items()
            },
            "instruments": [asdict(each) for each in self.instruments],
            "warnings": list(self.notes),
        }


def check_robot(robot: Robot) -> Check:
    """A robot measured with everything known, and with base and tool unknown."""
    tasks = {
        "position of the tool": Task.of("position"),
        "position, base and tool point unknown": Task.of("position", ("base", "tool")),
        "pose of the tool": Task.of("pose"),
        "pose, base and tool unknown": Task.of("pose", ("base", "tool")),
    }
    return Check(
        pose_at_zero(robot),
        {name: potential(build_model(robot, task)) for name, task in tasks.items()},
        (*parallel_axes(robot), *_asked(robot)),
    )


def check_model(model: Model) -> Check:
    """The measurement of an experiment; with several instruments also what each of them adds."""
    task = model.task
    unknown = unknown_words(task)
    name = ", ".join(o.instrument.name for o in task.observations) if len(task.observations) < 4 else "all instruments"
    words = f", {' and '.join(unknown)} unknown" if unknown else ""
    return Check(
        pose_at_zero(model.robot),
        {f"{name}{words}": potential(model)},
        (*parallel_axes(model.robot), *_no_length(model), *_asked(model.robot)),
        stack(model),
    )


@dataclass(frozen=True, slots=True)
class Added:
    """What an instrument reads of what, what of it is unknown, how many rows a pose has of it, and what rank it adds.

    alone: rank of its rows by themselves. added: to the rank of those before it.
    """

    name: str
    on: str
    reads: str
    of: str
    unknown: tuple[str, ...]
    rows: int
    alone: int
    added: int


def stack(model: Model) -> tuple[Added, ...]:
    """Every instrument in its order, by the numerical rank of noise-free rows over the whole joint ranges."""
    jacobian = _sampled(model)
    scales = model.parameters.scales
    index = model.parameters.indices((*model.kinematic, *model.placement))
    found, before = [], 0
    for part in model.measurement.parts:
        o, own = part.observation, slice(0, part.components.stop)
        ranks = [
            numerical_rank(jacobian[:, rows].reshape(-1, jacobian.shape[2])[:, index] * scales[index])
            for rows in (part.components, own)
        ]
        facts = observation_facts(o)
        features = f" {in_short(o.features)}" if o.features else ""
        found.append(
            Added(
                o.name,
                o.at.on,
                o.instrument.label,
                f"{o.target.name}{features}" + ("" if o.target.name == o.target.at.on else f" on {o.target.at.on}"),
                tuple(facts["unknown"]),
                part.components.stop - part.components.start,
                ranks[0],
                ranks[1] - before,
            )
        )
        before = ranks[1]
    return tuple(found)


def _asked(robot: Robot) -> tuple[str, ...]:
    """What measurements must say beside joint readings."""
    asking = [term for term in robot.terms if term.kind != "compliance"]  # which is seen by the nominal payload too
    wanted = dict.fromkeys(name for term in asking for name in term.conditions)
    if not wanted:
        return ()
    columns = [condition_columns(robot)[name][0] for name in wanted]
    return (
        f"joint terms depend on {listed(columns)}: only measurements with such columns tell their numbers; here they "
        "are taken to vary from pose to pose",
    )


def _no_length(model: Model) -> tuple[str, ...]:
    """That nothing which is read sees a length."""
    if model.measurement.sees_length:
        return ()
    known = ", and only known values, places and points tell" if model.measurement.knows_length else ""
    return (
        "nothing that is read has a length: if all lengths of the arm, its points and its places grow by one share, "
        f"no reading changes{known}. The plausible sizes hold that share, whatever the data say",
    )


def pose_at_zero(robot: Robot) -> Array:
    """T_world_tool with all joint readings at zero, shape (4, 4), mm."""
    kernel = batch_function(forward(chain(robot, parameter_set(robot))), evaluations=0)
    pose, _, _ = kernel(np.zeros((1, robot.dof)), np.zeros(len(robot.parameters)), frame_vector(robot.base, robot.tool))
    return np.asarray(pose[0])


def potential(model: Model) -> Identifiability:
    """What noise-free measurements over the whole joint ranges could see (numerical rank)."""
    free = (*model.kinematic, *model.placement)
    known = model.measurement.known_rows(np.zeros(len(model.parameters)), model.setup)
    stacked = np.vstack([_sampled(model).reshape(-1, len(model.parameters)), *(slopes for _, _, slopes in known)])
    return analyse(stacked, model.parameters, free, noise_known=False)


def _sampled(model: Model) -> Array:
    """Weighted Jacobians at many poses, shape (N, m, n); zero of what a posture does not touch."""
    rng = np.random.default_rng(0)
    lower, upper = model.robot.ranges
    setup, x = _somewhere(model, rng)
    setup = _within_reach(model, setup, x, lower, upper, rng)
    # orientations weigh like a point at 200 mm, so that the numerical rank does not depend on units
    weight = np.tile(model.measurement.per_unit({"mm": 1.0, "rad": 200.0, "px": 1.0}), (_SAMPLE, 1))

    def draw(count: int) -> Array:
        return rng.uniform(lower, upper, (count, len(lower)))

    parts = constraints(model.measurement)
    q = draw(_SAMPLE)
    if parts:
        there = replace(model, setup=model.moved(setup, x))
        q = contact_postures(there, _SAMPLE, draw, (lower, upper))
        for part, own in zip(parts, touched(model.measurement, there.setup, q).T, strict=True):
            weight[:, part.components] *= own[:, None]
    (jacobian,) = model.jacobian(q, x, setup.under(_conditions(model.robot, len(q), rng)))
    for part in model.measurement.parts:  # points at a camera's very centre would drown all others
        if part.observation.instrument.is_camera:
            rows = jacobian[:, part.components]
            size = np.linalg.norm(rows * model.parameters.scales, axis=2, keepdims=True)
            jacobian[:, part.components] = rows / np.maximum(size / np.median(size), 1.0)
    return np.asarray(jacobian * weight[:, :, None])


def _conditions(robot: Robot, count: int, rng: np.random.Generator) -> dict[str, Array]:
    """What joint terms depend on beside readings, as it may be: either direction, with and without a load."""
    loads, ways = (0.0, _LOAD), (-1.0, 1.0)
    return {
        name: np.asarray(rng.choice(loads if name == PAYLOAD else ways, count), dtype=np.float64)
        for name in robot.conditions
    }


def _within_reach(model: Model, setup: Setup, x: Array, lower: Array, upper: Array, rng: np.random.Generator) -> Setup:
    """The setup with constraints that nobody has placed where the point that touches them is at some posture."""
    places = dict(setup.places)
    for part in constraints(model.measurement):
        o = part.observation
        if o.at.frame is None and o.at.unknown and part.contact is not None:
            q = rng.uniform(lower, upper, (1, len(lower)))
            c, _, p = batch_function(part.contact, evaluations=0)(q, x, setup.vector)
            shift = p[0].ravel() if c.size == 3 else np.array([0.0, 0.0, c.ravel()[0]])
            places[o.place] = places[o.place] @ transform(np.eye(3), shift)
    return replace(setup, places=places)


def _somewhere(model: Model, rng: np.random.Generator) -> tuple[Setup, Array]:
    """Zero errors, shape (n,), but for points without coordinates: all at the flange they would see too little; and
    frames of instruments that nobody has placed anywhere, since at the robot's own base they would see too much or
    nothing."""
    blank = zip(model.measurement.points_called, model.setup.points, strict=True)
    unplaced = [
        c for name, point in blank if not point.any() for c in coordinate_names(name) if c in model.parameters.names
    ]
    x = model.parameters.vector({name: float(rng.uniform(50, 150)) for name in unplaced})
    places = {
        name: place.frame if place.frame is not None else _anywhere(place, rng)
        for name, place in places_of(model.task.everything).items()
    }
    return replace(model.setup, places=places), x


def _anywhere(place: Place, rng: np.random.Generator) -> Array:
    size = 100.0 if place.moves else 1500.0
    turn = scipy.spatial.transform.Rotation.random(rng=rng).as_matrix()
    return transform(turn, rng.uniform(0.3, 1.0, 3) * size * rng.choice([-1.0, 1.0], 3))


def parallel_axes(robot: Robot) -> tuple[str, ...]:
    """Neighbouring axes that are (nearly) parallel without beta: their misalignment cannot be told ([Hayati1985])."""
    notes: list[str] = []
    for i in range(1, robot.dof) if not is_given(robot) else ():
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
