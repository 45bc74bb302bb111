"""Robots and simulated measurements that several tests of identification share."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np

from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset
from symcal.instruments.noise import Noise
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.robot.files import load_robot
from symcal.robot.robot import Joint, Link, Robot

ROBOTS = Path(__file__).resolve().parent.parent / "configs" / "robots"

# [Ding2017] Table III, mm and rad; alpha_5 cannot be seen and is not in the robot's table
TABLE_III = {
    "theta_1": 0.002638,
    "theta_4": 0.001455,
    "theta_5": -0.001361,
    "alpha_1": 0.003693,
    "alpha_2": -0.005797,
    "alpha_3": 0.005499,
    "alpha_4": 0.001450,
    "a_4": -0.0760,
    "a_5": 0.0240,
    "d_2": 0.0184,
    "d_3": 0.0240,
    "d_4": -0.0417,
    "d_5": 0.0530,
    "beta_1": 0.00123,
    "beta_3": 0.006221,
}


def revolute(limit: float = 2.5, **parameters: float) -> Link:
    return Link(Joint("revolute", "r", -limit, limit), parameters)


def prismatic(**parameters: float) -> Link:
    return Link(Joint("prismatic", "p", 0.0, 500.0), parameters)


QUARTER = np.pi / 2

# six axes, three of them parallel, as small industrial arms have them (craig)
ARM = Robot(
    "arm",
    "craig",
    (
        revolute(theta=0.0, d=163.0),
        revolute(alpha=QUARTER, a=0.0, theta=0.0, d=0.0),
        revolute(alpha=0.0, a=-425.0, beta=0.0, theta=0.0),
        revolute(alpha=0.0, a=-392.0, beta=0.0, theta=0.0, d=127.0),
        revolute(alpha=QUARTER, a=0.0, theta=0.0, d=100.0),
        revolute(alpha=-QUARTER, a=0.0, theta=0.0, d=100.0),
    ),
)

# three parallel axes: hand and eye cannot be told apart along them
PLANAR = Robot("planar", "craig", tuple(revolute(theta=0.0, d=0.0, a=300.0, alpha=0.0, beta=0.0) for _ in range(3)))


@cache
def handling() -> Robot:
    return load_robot(ROBOTS / "handling_robot.yaml")


@cache
def handling_model(*points: str, estimate: frozenset[str] = frozenset()) -> Model:
    """The handling robot measured in position; at its last origin when no points are named."""
    places = {"P": (0.0, 0.0, 0.0)} if not points else dict(zip(points, TRIANGLE, strict=True))
    return build_model(handling(), Task.of("position", estimate, places))  # type: ignore[arg-type]


TRIANGLE = ((50.0, 0.0, 100.0), (0.0, 50.0, 100.0), (-30.0, 0.0, 150.0))


def front_half(count: int, rng: np.random.Generator) -> np.ndarray:
    """Readings of the handling robot over its working area, shape (count, 5)."""
    lower, upper = handling().lower.copy(), handling().upper.copy()
    lower[0], upper[0] = -QUARTER, QUARTER
    return rng.uniform(lower, upper, (count, 5))


def anywhere(robot: Robot, count: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(robot.lower, robot.upper, (count, robot.dof))


def random_errors(model: Model, rng: np.random.Generator, mm: float = 0.3, rad: float = 2e-3) -> dict[str, float]:
    sizes = {"mm": mm, "rad": rad}
    return {p.name: float(rng.normal() * sizes[p.unit]) for p in model.parameters.items}


def measure(
    model: Model,
    truth: Mapping[str, float],
    count: int,
    rng: np.random.Generator,
    position: float = 0.0,
    orientation: float = 0.0,
) -> Dataset:
    """Random poses of the robot measured with normal noise, mm and rad."""
    q = front_half(count, rng) if model.robot is handling() else anywhere(model.robot, count, rng)
    return simulate(model, truth, q, Noise("normal", position, orientation), rng)
