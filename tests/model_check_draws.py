"""Model checks of many drawn identifications: uniform under the true model, and right about what was planted.

    python tests/model_check_draws.py [draws [cases]]      long form of test_model_check.py: 200 draws of each case

What is planted is planted in NumPy: the robot is simulated at other readings than the data say, or the readings drift.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from cases import ARM, ROBOTS, handling, random_errors
from known_truth import SCENARIOS, measured, sessions, told
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial.transform import Rotation
from strategies import random_frame

from symcal.calibration.calibrate import calibrate
from symcal.calibration.model_check import ModelCheck, lacks_physics, model_check
from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.robot.files import load_robot
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
Plant = Callable[[Array, np.random.Generator], Array]
NOISE = 0.05


@cache
def model_of(robot: Robot, kind: str, points: int = 1) -> Model:
    places = {"abc"[i]: ((30.0, 20.0, 80.0), (-40.0, 60.0, 50.0), (10.0, -50.0, 120.0))[i] for i in range(points)}
    return build_model(robot, Task.of(kind, frozenset({"base", "tool"}), places))  # type: ignore[arg-type]


def checked(
    model: Model,
    count: int,
    rng: np.random.Generator,
    *,
    share: float = 1.0,
    planted: Plant | None = None,
    drift: Array | None = None,
    shaky: float = 0.0,
    options: Options = Options(),
) -> ModelCheck:
    """A robot with drawn errors, measured and identified; its check.

    Args:
        share: of the ranges of the joints. planted: what the joints move by beyond their readings. drift: of z over the
            run. shaky: standard deviation of the joints themselves, rad.
    """
    robot = model.robot
    lower, upper = robot.ranges
    middle, half = (upper + lower) / 2, (upper - lower) / 2
    if share < 1:
        middle = middle + (1 - share) * rng.uniform(-0.6, 0.6, robot.dof) * half
    q = middle + share * half * rng.uniform(-1, 1, (count, robot.dof))
    moved = q if planted is None else q + planted(q, rng)
    moved = moved + shaky * rng.normal(size=q.shape)
    true = replace(model, setup=replace(model.setup, base=random_frame(rng, 2000.0)))
    data = simulate(true, random_errors(model, rng), moved, Noise("normal", NOISE, 1e-4), rng)
    z = data.z.copy()
    if drift is not None:
        z[:, : len(drift)] += np.linspace(0, 1, count)[:, None] * drift
    data = replace(data, q=q, z=z)
    return model_check(calibrate(model, None, data, options), data, options)


def scene(name: str, rng: np.random.Generator) -> ModelCheck:
    model, data = measured_scene(name, rng)
    return model_check(calibrate(model, None, data, Options()), data, Options())


def measured_scene(name: str, rng: np.random.Generator) -> tuple[Model, Dataset]:
    """Of a scenario of `known_truth`, its noise unknown."""
    scenario = SCENARIOS[name](rng)
    model = told(name, scenario)
    p = model.parameters
    errors = {n: float(rng.normal() * s * 0.3) for n, s in zip(p.names, p.scales, strict=True) if n in ARM.parameters}
    true = replace(model, setup=scenario.setup)
    data = simulate(true, errors, measured(true, scenario, rng), Noise(by_instrument=scenario.noise), rng)
    data = replace(data, z=sessions(model, data.z))
    return model, data


@cache
def positioner() -> Robot:
    return load_robot(ROBOTS / "two_axis_positioner.yaml")


# -------------------------------------------------------------------------------------------------------------- plants


def wave(q: Array, rng: np.random.Generator) -> Array:
    """Half a mrad, once to a turn of joint 3."""
    return only(3, 0.5e-3 * np.sin(q[:, 2] + rng.uniform(-np.pi, np.pi)))


def play(q: Array, _: np.random.Generator) -> Array:
    """Joint 4 stops 0.3 mrad short of its reading."""
    return only(4, -0.3e-3 * np.sign(np.diff(q[:, 3], prepend=q[0, 3])))


def sag(q: Array, _: np.random.Generator) -> Array:
    """Joint 2 yields by 1 mrad to the moment of 60 Nm: 5 kg on the forearm and 5 kg at the wrist."""
    where = np.tile(np.eye(4), (len(q), 1, 1))
    frames = []
    for link, reading in zip(ARM.links, q.T, strict=True):
        p = link.parameters
        where = where @ screw("x", p.get("alpha", 0.0), p.get("a", 0.0))
        where = where @ screw("z", p.get("theta", 0.0) + reading, p.get("d", 0.0))
        frames.append(where)
    axis, at = frames[1][:, :3, 2], frames[1][:, :3, 3]
    moment = np.zeros(len(q))
    for carried in (frames[2], frames[4]):
        weight = np.array([0.0, 0.0, -5 * 9.81])
        moment += np.sum(axis * np.cross(carried[:, :3, 3] - at, weight), axis=1)
    return only(2, 1e-3 / 60e3 * moment)


def screw(axis: str, angle: Any, length: float) -> Array:
    angle = np.atleast_1d(angle)
    out = np.tile(np.eye(4), (len(angle), 1, 1))
    out[:, :3, :3] = Rotation.from_euler(axis, angle[:, None]).as_matrix()
    out[:, "xyz".index(axis), 3] = length
    return out


def only(joint: int, motion: Array) -> Array:
    out = np.zeros((len(motion), ARM.dof))
    out[:, joint - 1] = motion
    return out


def planted(what: str, rng: np.random.Generator) -> ModelCheck:
    """60 poses all over the ranges, with one thing that the model lacks."""
    model = model_of(ARM, "position")
    if what == "drift":
        way = rng.normal(size=3)
        return checked(model, 60, rng, drift=0.2 * way / np.linalg.norm(way))
    return checked(model, 60, rng, planted={"wave": wave, "sag": sag, "play": play}[what])


PLANTED = {
    "wave": "a wave of joint 3, 1 to a turn",
    "sag": "gravity at joint 2",
    "play": "the direction from which joint 4 came",
    "drift": "the order of the measurements (position)",
}

SCENES = (
    "three_wires",
    "two_dial_gauges",
    "two_sessions",
    "directions_only",
    "one_pin",
    "two_sockets",
    "three_planes",
    "two_cameras_board",
    "eye_in_hand_board",
    "pin_and_camera",
)
"""Of `known_truth`: several instruments, contacts, cameras."""

GOOD: dict[str, Callable[[np.random.Generator], ModelCheck]] = {
    "position": lambda rng: checked(model_of(ARM, "position"), 60, rng),
    "position, 15 poses": lambda rng: checked(model_of(ARM, "position"), 15, rng),
    "position, narrow": lambda rng: checked(model_of(ARM, "position"), 60, rng, share=0.1),
    "position, huber": lambda rng: checked(model_of(ARM, "position"), 60, rng, options=Options(loss="huber")),
    "position, noise stated half": lambda rng: checked(
        model_of(ARM, "position"), 60, rng, options=Options(sigma={"position": NOISE / 2})
    ),
    "three points, joints shake": lambda rng: checked(model_of(ARM, "position", 3), 60, rng, shaky=1e-4),
    "position, joints shake": lambda rng: checked(model_of(ARM, "position"), 60, rng, shaky=1e-4),
    "pose, joints shake": lambda rng: checked(model_of(ARM, "pose"), 60, rng, shaky=1e-4),
    "three points": lambda rng: checked(model_of(ARM, "position", 3), 60, rng),
    "pose": lambda rng: checked(model_of(ARM, "pose"), 40, rng),
    "pose, 15 poses": lambda rng: checked(model_of(ARM, "pose"), 15, rng),
    "positioner": lambda rng: checked(model_of(positioner(), "pose"), 40, rng),
    "handling": lambda rng: checked(model_of(handling(), "position"), 40, rng),
    **{name: lambda rng, name=name: scene(name, rng) for name in SCENES},
}


def draws(case: str, count: int, seed: int = 0) -> list[ModelCheck]:
    made = (lambda rng: planted(case, rng)) if case in PLANTED else GOOD[case]
    found: list[ModelCheck] = []
    for i in range(count):
        try:
            found.append(made(np.random.default_rng([seed, i])))
        except RefusedError as error:
            sys.stdout.write(f"  {case} {i}: {error}\n")
    return found


def uniform(found: list[ModelCheck], seed: int = 0) -> float:
    """Probability of p-values as far from uniform as these: one of every check, whichever."""
    rng = np.random.default_rng(seed)
    picked = [float(rng.choice([test.p for test in check.tests])) for check in found if check.tests]
    return float(stats.kstest(picked, "uniform").pvalue)


def told_of(found: list[ModelCheck], case: str) -> str:
    """A line of numbers."""
    false = [check for check in found if lacks_physics(check)]
    if case in PLANTED:
        right = sum(bool(check.causes) and check.causes[0].name == PLANTED[case] for check in found)
        first = Counter(check.causes[0].name if check.causes else "nothing" for check in found)
        more = sum(len(check.causes) > 1 for check in found)
        return f"{case}: {right} of {len(found)} named right, {more} with more beside; {dict(first)}"
    kinds = sorted({test.kind for check in found for test in check.tests})
    by_kind = {}
    for kind in kinds:
        rng = np.random.default_rng(0)
        p = [[t.p for t in check.tests if t.kind == kind] for check in found]
        by_kind[kind] = round(float(stats.kstest([rng.choice(each) for each in p if each], "uniform").pvalue), 3)
    named = Counter(cause.kind for check in false for cause in check.causes)
    return (
        f"{case}: {len(false)} of {len(found)} lack something {dict(named)}; KS {uniform(found):.3f}, by kind "
        f"{by_kind}; "
        f"{sum(not check.tests for check in found)} not tested"
    )


if __name__ == "__main__":
    wanted = sys.argv[2:] or [*PLANTED, *GOOD]
    for name in wanted:
        sys.stdout.write(told_of(draws(name, int(sys.argv[1]) if len(sys.argv) > 1 else 200), name) + "\n")
        sys.stdout.flush()
