"""Joint terms of simulated arms, identified: errors over their standard deviations against the chi-squared law.

    python tests/term_law.py [draws [sets]]        long form of test_term_identification.py: 200 draws of each set

Measurements come from the NumPy model of term_witness.py, not from the package.
"""

# ruff: noqa: T201

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from cases import ARM
from scipy import stats
from scipy.spatial.transform import Rotation
from term_witness import poses

from symcal.calibration.calibrate import Calibration, calibrate
from symcal.data.dataset import Dataset, readings
from symcal.fit.estimation import Options
from symcal.joints import Term
from symcal.joints.arm import Mass
from symcal.joints.backlash import Backlash
from symcal.joints.compliance import Compliance
from symcal.joints.coupling import Coupling
from symcal.joints.gravity import Gravity
from symcal.joints.harmonics import Harmonics
from symcal.joints.payload import PayloadTerm
from symcal.joints.ratio import Ratio
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.robot.robot import Robot

POSES = 50
MM, RAD = 0.02, 1e-4
SHARE = 0.1  # of the plausible sizes of links, so that the arm is linear at the noise
SETS: dict[str, tuple[Term, ...]] = {
    "waves and ratios": (
        *(Harmonics(j, True, k=(1, 2)) for j in (1, 2, 4)),
        *(Ratio(j, True) for j in (2, 3)),
        Coupling(5, True, by=4),
        Coupling(6, True, by=5),
    ),
    "gravity": (
        Gravity(2, True, points=("x", "y", "q4", "q5", "flange")),
        Gravity(3, True, points=("x", "y", "q5", "flange")),
    ),
    "compliance, backlash and payload": (
        *(Compliance(j, True) for j in (2, 3, 4)),
        *(Backlash(j, True) for j in (1, 2, 5)),
        PayloadTerm(3, True),
    ),
}
MASSES = (Mass(2, 12.0, (-200.0, 0.0, 60.0)), Mass(3, 6.0, (-190.0, 10.0, 0.0)), Mass(7, 2.0))


@cache
def model_of(name: str, kind: str = "pose") -> Model:
    robot = replace(ARM, terms=SETS[name], masses=MASSES)
    return build_model(robot, Task.of(kind, scales={n: SHARE * v for n, v in sizes(robot).items()}))


def sizes(robot: Robot) -> dict[str, float]:
    return {p.name: p.scale for p in robot.described if not p.group}


@dataclass(frozen=True)
class Draw:
    truth: dict[str, float]
    data: Dataset


def measured(
    robot: Robot,
    truth: Mapping[str, float],
    q: np.ndarray,
    rng: np.random.Generator,
    conditions: Mapping[str, np.ndarray] | None = None,
    noise: float = 1.0,
) -> Dataset:
    """Poses of the tool of the witness, with noise."""
    found = []
    for i, row in enumerate(q):
        given = {name: values[i] for name, values in (conditions or {}).items()}
        t = poses(robot, row, truth, given)["tool"].real
        turned = t[:3, :3] @ Rotation.from_rotvec(noise * RAD * rng.normal(size=3)).as_matrix()
        found.append([*(t[:3, 3] + noise * MM * rng.normal(size=3)), *Rotation.from_matrix(turned).as_quat()])
    labels = tuple(map(str, range(len(q))))
    return Dataset(readings("pose"), q, np.array(found), labels, ("train",) * len(q), conditions=conditions or {})


def draw(name: str, seed: int) -> Draw:
    """Errors of the plausible sizes, poses anywhere, every direction and two payloads."""
    model, rng = model_of(name), np.random.default_rng(seed)
    robot = model.robot
    truth = {p.name: float(p.scale * rng.normal()) for p in model.parameters.items}
    # none near zero: the factor of a group of few numbers would fall to nothing, and their uncertainty with it
    truth |= {n: float(p.scale * rng.choice([-1, 1]) * rng.uniform(0.7, 1.5)) for n, p in robot.term_parameters.items()}
    q = rng.uniform(robot.lower, robot.upper, (POSES, robot.dof))
    conditions = {
        c: 5.0 * rng.integers(0, 2, POSES) if c == "payload" else rng.choice([-1.0, 1.0], POSES)
        for c in robot.conditions
    }
    return Draw(truth, measured(robot, truth, q, rng, conditions))


def identified(model: Model, data: Dataset, sigma: bool = True) -> Calibration:
    known = {"position": MM, "orientation": RAD} if sigma else {}
    return calibrate(model, None, data, Options(sigma=known, scales="stated"))


def squares(name: str, seed: int) -> tuple[float, int, np.ndarray]:
    """e^T C^-1 e of the terms' numbers, how many they are, and each error over its standard deviation."""
    drawn, model = draw(name, seed), model_of(name)
    found = identified(model, drawn.data).after
    assert found.converged
    terms = list(model.robot.term_parameters)
    at = [found.posterior.names.index(n) for n in terms]
    covariance = found.posterior.covariance[np.ix_(at, at)]
    error = np.array([model.parameters.mapping(found.x)[n] - drawn.truth[n] for n in terms])
    sigma = np.sqrt(np.diag(covariance))
    white = np.linalg.solve(np.linalg.cholesky(covariance / np.outer(sigma, sigma)), error / sigma)
    return float(white @ white), len(terms), error / sigma


def law(name: str, draws: int) -> tuple[float, float]:
    """The sum of squares over its expectation, and its probability (the smaller tail)."""
    found = [squares(name, seed) for seed in range(draws)]
    total, count = sum(s for s, *_ in found), sum(n for _, n, _ in found)
    below = stats.chi2.cdf(total, count)
    return total / count, float(min(below, 1 - below))


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for which in sys.argv[2:] or SETS:
        ratio, tail = law(which, count)
        print(f"{which}: squares over expected {ratio:.3f}, tail {tail:.2g}, {count} draws")
