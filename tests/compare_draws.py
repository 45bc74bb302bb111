"""Pairs of simulated calibrations with different plans and set-ups: of one robot, and of one that changed in between.

python tests/compare_draws.py [pairs]        long form of test_compare_runs.py: 400 pairs of each case
"""

# ruff: noqa: T201

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

import numpy as np
from cases import ARM, handling, random_errors
from model_check_draws import model_of
from scipy import stats
from strategies import random_frame

from symcal.calibration.calibrate import calibrate
from symcal.calibration.robot_difference import RobotDifference, robot_difference
from symcal.calibration.simulate import simulate
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.robot.robot import Robot


@dataclass(frozen=True)
class Case:
    """Which robot, by what it is measured, poses of the two plans, share of the ranges of the second one, and size of
    the errors (mm; rad by 7e-3 of it)."""

    robot: str
    kind: str
    poses: tuple[int, int]
    share: float
    size: float


CASES = {
    "arm": Case("arm", "position", (40, 30), 0.6, 0.3),
    "far off": Case("arm", "position", (40, 30), 0.6, 3.0),
    "small area": Case("arm", "position", (18, 60), 0.5, 0.3),
    "prismatic, poses": Case("handling", "pose", (25, 40), 1.0, 1.0),
    "prismatic, few": Case("handling", "position", (20, 15), 1.0, 0.3),
    "arm, few poses": Case("arm", "pose", (15, 15), 0.3, 0.3),
}


def calibrated(robot: Robot, kind: str, errors: dict[str, float], count: int, share: float, seed: list[int]) -> Robot:
    """A calibration of a robot with these errors at poses, a base and noise that the seed draws."""
    rng, model = np.random.default_rng(seed), model_of(robot, kind)
    lower, upper = robot.ranges
    middle, half = (upper + lower) / 2, (upper - lower) / 2
    middle = middle + (1 - share) * rng.uniform(-0.6, 0.6, robot.dof) * half
    q = middle + share * half * rng.uniform(-1, 1, (count, robot.dof))
    there = replace(model, setup=replace(model.setup, base=random_frame(rng, 2000.0)))
    return calibrate(model, None, simulate(there, errors, q, Noise("normal", 0.05, 1e-4), rng), Options()).robot


def compared(case: Case, seed: int, change: dict[str, float] | None = None) -> RobotDifference:
    """Two calibrations of one robot, which changed in between if wanted."""
    robot = {"arm": ARM, "handling": handling()}[case.robot]
    drawn = random_errors(model_of(robot, case.kind), np.random.default_rng([seed, 1]), case.size, 7e-3 * case.size)
    errors = {name: value for name, value in drawn.items() if name in robot.parameters}
    later = {name: value + (change or {}).get(name, 0.0) for name, value in errors.items()}
    return robot_difference(
        calibrated(robot, case.kind, errors, case.poses[0], 1.0, [seed, 2]),
        calibrated(robot, case.kind, later, case.poses[1], case.share, [seed, 3]),
    )


def main(pairs: int) -> None:
    for name, case in CASES.items():
        found = [compared(case, seed) for seed in range(pairs)]
        p = np.array([each.numbers.p for each in found])
        ratio = np.sqrt(np.mean([(each.tool.rms / each.tool.expected) ** 2 for each in found]))
        print(
            f"{name}: {found[0].numbers.directions} of {len(found[0].names)} directions; p uniform "
            f"{stats.kstest(p, 'uniform').pvalue:.3f}, below 0.05 {np.mean(p < 0.05):.3f}, below 0.01 "
            f"{np.mean(p < 0.01):.3f}; a parameter named {np.mean([bool(each.differing) for each in found]):.3f}; tool "
            f"over expected {ratio:.3f}",
            flush=True,
        )
        if name == "arm":
            changed = [compared(case, seed, {"a_3": 0.3}) for seed in range(pairs)]
            named = [each.differing for each in changed]
            first, others = np.mean([n[:1] == ("a_3",) for n in named]), np.mean([len(n) > 1 for n in named])
            print(f"a_3 0.3 mm longer: named first {first:.3f}, others too {others:.3f}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 400)
