"""A six-axis arm with joint terms, as an identification leaves it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from decisions import ACCEPTED

from symcal import spatial
from symcal.joints import Term
from symcal.joints.gravity import Gravity
from symcal.joints.harmonics import Harmonics
from symcal.robot.robot import Joint, Link, Record, Robot, is_angle


def six_axis(geared: bool = False) -> Robot:
    """A puma-like arm; geared: with signs, ratios and offsets in its readings."""
    rows = [
        {"alpha": 0.0, "a": 0.0, "d": 400.0, "theta": 0.0},
        {"alpha": -np.pi / 2, "a": 25.0, "theta": 0.0, "beta": 0.0},
        {"alpha": 0.0, "a": 560.0, "beta": 0.0, "theta": 0.0, "d": 0.0},
        {"alpha": -np.pi / 2, "a": 35.0, "d": 515.0, "theta": 0.0},
        {"alpha": np.pi / 2, "a": 0.0, "d": 0.0, "theta": 0.0},
        {"alpha": -np.pi / 2, "a": 0.0, "d": 80.0, "theta": 0.0},
    ]
    links = []
    for i, row in enumerate(rows):
        reading = {"sign": -1, "ratio": 50.0 + i, "offset": 0.2} if geared else {}
        scale = reading.get("ratio", 1.0)
        links.append(Link(Joint("revolute", f"axis {i + 1}", lower=-2.6 / scale, upper=2.6 / scale, **reading), row))
    tool = spatial.transform(spatial.rpy_matrix(np.array([0.1, -0.2, 0.3])), np.array([10.0, -20.0, 120.0]))
    return Robot("puma", "craig", tuple(links), tool=tool)


def usual_terms() -> tuple[Term, ...]:
    """Harmonics of all joints, and gravity where an arm yields to it."""
    waves = [Harmonics(i, True, k=(1, 2)) for i in range(1, 7)]
    weights = [
        Gravity(2, True, points=("x", "q4")),
        Gravity(3, True, points=("x", "y", "flange")),
        Gravity(5, True, points=("x", "y")),
    ]
    return (*waves, *weights)


def calibrated(robot: Robot, rng: np.random.Generator, size: float = 1.0) -> Robot:
    """The robot with identified errors: 1 mrad, 0.3 mm, and joint terms as large as plausible times ``size``."""
    errors = {
        name: float(rng.normal() * (1e-3 if is_angle(name.rpartition("_")[0]) else 0.3))
        for name in robot.link_parameters
    }
    errors |= {name: float(size * rng.normal() * p.scale) for name, p in robot.term_parameters.items()}
    n = len(errors)
    record = Record(errors, dict.fromkeys(errors, 1e-4), 1e-8 * np.eye(n), robot.base, robot.tool, ACCEPTED)
    return replace(robot.corrected(errors), record=record)


def puma_with_terms() -> Robot:
    return calibrated(replace(six_axis(), terms=usual_terms()), np.random.default_rng(5))
