"""Random robots for property tests: every convention, joint kind, subset of parameters, sign, ratio and offset."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from symcal.robot.robot import LINK_PARAMETERS, Convention, Joint, Link, Record, Robot, is_angle


def random_frame(rng: np.random.Generator, size: float = 500.0) -> np.ndarray:
    frame = np.eye(4)
    frame[:3, :3] = Rotation.random(rng=rng).as_matrix()
    frame[:3, 3] = rng.uniform(-size, size, 3)
    return frame


def random_link(rng: np.random.Generator, index: int) -> Link:
    kinds = [kind for kind in LINK_PARAMETERS if rng.random() < 0.75]
    revolute = rng.random() < 0.7
    span = 3.0 if revolute else 600.0
    limited = rng.random() < 0.7
    joint = Joint(
        kind="revolute" if revolute else "prismatic",
        name=f"axis {index}",
        lower=float(-rng.uniform(0.1, span)) if limited else -math.inf,
        upper=float(rng.uniform(0.1, span)) if limited else math.inf,
        sign=1 if rng.random() < 0.5 else -1,
        ratio=float(rng.choice([1.0, 0.5, 1.02])),
        offset=float(rng.choice([0.0, rng.uniform(-span, span)])),
        speed=float(rng.uniform(0.1, span)) if rng.random() < 0.5 else None,
    )
    return Link(joint, {k: float(rng.uniform(-3, 3) if is_angle(k) else rng.uniform(-500, 500)) for k in kinds})


def random_robot(rng: np.random.Generator, convention: Convention | None = None, dof: int | None = None) -> Robot:
    dof = dof or int(rng.integers(1, 8))
    robot = Robot(
        name=f"robot {dof}",
        convention=convention or ("standard", "craig")[int(rng.integers(2))],
        links=tuple(random_link(rng, i) for i in range(1, dof + 1)),
        base=random_frame(rng),
        tool=random_frame(rng),
    )
    return Robot(
        robot.name,
        robot.convention,
        robot.links,
        robot.base,
        robot.tool,
        scales={name: float(rng.uniform(0.001, 5)) for name in robot.parameters if rng.random() < 0.3},
        record=random_record(rng, robot) if rng.random() < 0.5 else None,
    )


def random_record(rng: np.random.Generator, robot: Robot) -> Record:
    names = [*robot.parameters, "base_x", "base_rz", "tool_P1_x"]
    half = rng.normal(size=(len(names), len(names)))
    return Record(
        errors={name: float(rng.normal(scale=0.01)) for name in names},
        sigmas={name: float(rng.uniform(0, 1)) if rng.random() < 0.8 else None for name in names},
        covariance=half @ half.T,
        nominal_base=random_frame(rng),
        nominal_tool=random_frame(rng),
        provenance={"seed": 7, "inputs": {"data.csv": "ab12"}, "rms_mm": 0.5, "list": ["a", 1], "none": None},
    )


def readings(rng: np.random.Generator, robot: Robot) -> np.ndarray:
    """Joint readings, rad or mm, regardless of limits."""
    return np.array([rng.uniform(-3, 3) if joint.revolute else rng.uniform(-500, 500) for joint in robot.joints])


seeds = st.integers(0, 2**32 - 1)
generators = seeds.map(np.random.default_rng)
robots = generators.map(random_robot)
