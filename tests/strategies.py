"""Random robots for property tests: every convention, joint kind, subset of parameters, sign, ratio and offset."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from symcal.joints import Term
from symcal.joints.arm import Mass, Payload
from symcal.joints.backlash import Backlash
from symcal.joints.compliance import Compliance
from symcal.joints.coupling import Coupling
from symcal.joints.gravity import Gravity
from symcal.joints.harmonics import Harmonics
from symcal.joints.payload import PayloadTerm
from symcal.joints.ratio import Ratio
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


def with_terms(rng: np.random.Generator, robot: Robot, size: float = 1.0) -> Robot:
    """The robot with some joint terms of every kind, about as large as plausible times ``size``, and with masses, a
    payload and gravity in any direction."""
    n, turns = robot.dof, [joint.revolute for joint in robot.joints]
    terms: list[Term] = []
    for i in range(1, n + 1):
        own, pitch = ("x", "y") if turns[i - 1] else ("x",), None if turns[i - 1] else float(rng.uniform(5, 50))
        gear = float(rng.uniform(5, 100)) if turns[i - 1] and rng.random() < 0.3 else None
        by = int(rng.integers(1, n + 1))
        terms += [
            Ratio(i, turns[i - 1]),
            Harmonics(i, turns[i - 1], k=(1, 2), gear=gear, pitch=pitch),
            Backlash(i, turns[i - 1]),
            Compliance(i, turns[i - 1]),
            Gravity(i, turns[i - 1], points=(*own, *(f"q{j}" for j in range(i + 1, n + 1) if rng.random() < 0.4))),
            PayloadTerm(i, turns[i - 1]),
        ]
        terms += [Coupling(i, turns[i - 1], by=by, by_revolute=turns[by - 1])] if by != i else []
    terms = [term for term in terms if rng.random() < 0.7]
    values = {p.name: float(size * rng.normal() * p.scale) for term in terms for p in term.parameters}
    down = rng.normal(size=3)
    down /= np.linalg.norm(down)
    masses = [Mass(i, float(rng.uniform(0, 20)), triple(rng.uniform(-200, 200, 3))) for i in range(1, n + 2)]
    return replace(
        robot,
        terms=tuple(term.corrected(values) for term in terms),
        down=triple(down),
        masses=tuple(masses),
        payload=Payload(float(rng.uniform(0, 5)), triple(rng.uniform(-100, 100, 3))),
    )


def triple(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


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
