"""How often calibrations are accepted: of good robots, and of robots that there is nothing to calibrate about.

    python tests/decision_draws.py N        so many sets of each kind

Long form of `test_decision_draws.py`. Measured poses are random, errors normal with the plausible sizes (1 mm, 10 mrad)
or none at all, and the noise is not told to the identification.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from measured_arms import POINTS, arm

from symcal.calibration.calibrate import baseline_model, calibrate
from symcal.calibration.judgement import decide_alone
from symcal.calibration.simulate import simulate
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.model.model import build_model
from symcal.model.task import Task


@dataclass(frozen=True)
class Kind:
    """Sets of a kind: so many poses over a share of the joints' ranges, errors of so many plausible sizes, noise in
    mm."""

    poses: int
    reach: float = 1.0
    size: float = 1.0
    noise: float = 0.05


KINDS = {
    "40 poses": Kind(40),
    "15 poses": Kind(15),
    "a tenth of the ranges": Kind(40, 0.1),
    "three times the plausible sizes": Kind(40, size=3.0),
    "noise of half a millimetre": Kind(40, noise=0.5),
    "a perfect robot": Kind(40, size=0.0),
}


def accepted(kind: Kind, sets: int, seed: int = 1) -> tuple[int, int]:
    """How many of so many sets are accepted, and how many were never identified."""
    robot = arm("puma", "standard")
    model = build_model(robot, Task.of("position", frozenset({"base"}), POINTS))
    baseline, scales = baseline_model(model), model.parameters.scales
    index = model.parameters.indices(model.kinematic)
    good = refused = 0
    for rng in np.random.default_rng(seed).spawn(sets):
        truth = dict(zip(model.kinematic, kind.size * scales[index] * rng.normal(size=index.size), strict=True))
        q = kind.reach * rng.uniform(robot.lower, robot.upper, (kind.poses, robot.dof))
        data = simulate(model, truth, q, Noise(position=kind.noise), rng)
        try:
            found = calibrate(model, baseline, data, Options())
        except RefusedError:
            refused += 1
            continue
        good += decide_alone(found, data, Options()).accepted
    return good, refused


def main(sets: int) -> None:
    for name, kind in KINDS.items():
        good, refused = accepted(kind, sets)
        sys.stdout.write(f"{name}: {good} of {sets} accepted, {refused} not identified\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(int(sys.argv[1]))
