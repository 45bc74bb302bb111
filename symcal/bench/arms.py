"""Arms to measure on, made here: an installed package has no files of robots."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from symcal.robot.robot import Joint, Link, Robot

Array = NDArray[np.float64]

_RIGHT = math.pi / 2

# Plausible sizes of what is wrong with an arm: mm and rad.
_LENGTH, _ANGLE = 1.0, 3e-3


def handling_robot() -> Robot:
    """The five-axis arm of [Ding2017], Tables I and II: 15 parameters, of which positions see 11."""

    def turning(name: str, low: float, high: float, **parameters: float) -> Link:
        return Link(Joint("revolute", name, math.radians(low), math.radians(high)), {"theta": 0.0, **parameters})

    def sliding(name: str, low: float, high: float, **parameters: float) -> Link:
        return Link(Joint("prismatic", name, low, high), {"d": 0.0, **parameters})

    links = (
        turning("waist", -165, 165, alpha=0.0, beta=0.0),
        sliding("lift", 850, 1350, alpha=-_RIGHT),
        sliding("reach", 0, 700, alpha=0.0, beta=0.0),
        turning("elbow", 0, 175, d=300.0, a=0.0, alpha=-_RIGHT),
        turning("wrist", -175, 175, d=25.0, a=0.0),
    )
    return Robot("handling-robot", "standard", links)


def revolute_arm(joints: int, parameters: int | None = None) -> Robot:
    """An arm of revolute joints whose neighbours stand at right angles, with four parameters a joint (standard).

    Args:
        parameters: how many it has, beginning at the first joint; all 4 * joints when None.
    """
    links = []
    left = 4 * joints if parameters is None else parameters
    for i in range(joints):
        side = 1.0 if i % 2 else -1.0
        given = {"theta": 0.0, "alpha": side * _RIGHT, "a": 60.0 + 10.0 * i, "d": 300.0 - 15.0 * i}
        kept = dict(list(given.items())[: max(left, 0)])
        left -= len(kept)
        links.append(Link(Joint("revolute", f"joint_{i + 1}", -2.8, 2.8), kept))
    return Robot(f"arm-{joints}", "standard", tuple(links))


def random_postures(robot: Robot, count: int, rng: np.random.Generator) -> Array:
    """Joint readings uniform in their ranges, shape (count, dof)."""
    return rng.uniform(*robot.ranges, (count, robot.dof))


def random_errors(names: tuple[str, ...], rng: np.random.Generator) -> Array:
    """Errors of so many link parameters, shape (n,), mm and rad."""
    sizes = [_ANGLE if name.startswith(("theta", "alpha", "beta")) else _LENGTH for name in names]
    return rng.normal(0.0, sizes)
