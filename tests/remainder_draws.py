"""Remainders looked for where there is none: `python tests/remainder_draws.py N`; the tests have a short form."""

# ruff: noqa: T201

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from symcal import spatial
from symcal.calibration.calibrate import Calibration, calibrate
from symcal.calibration.remainder import with_remainder
from symcal.calibration.simulate import concatenate, simulate
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.joints.remainder import Kernel, Remainder
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.robot.robot import Joint, Link, Robot

NOISE = 0.02
TASK = Task.of("position", ("base", "tool"), {"P": (0.0, 0.0, 0.0)})


def arm() -> Robot:
    """Three joints and a wrist of one: every length scale is searched."""
    turn = np.pi / 2

    rows = (
        {"theta": 0.0, "d": 300.0, "a": 50.0, "alpha": turn},
        {"theta": 0.0, "a": 400.0, "alpha": 0.0, "beta": 0.0},
        {"theta": 0.0, "d": 0.0, "a": 300.0, "alpha": turn},
        {"theta": 0.0, "d": 100.0, "a": 80.0, "alpha": 0.0},
    )
    links = tuple(Link(Joint("revolute", f"r{i}", -1.5, 1.5), row) for i, row in enumerate(rows, start=1))
    return Robot("arm", "standard", links, tool=spatial.transform(np.eye(3), np.array([20.0, 10.0, 60.0])))


def planted(robot: Robot, rng: np.random.Generator) -> Robot:
    """The same arm, displaced smoothly by some tenths of a millimetre."""
    centres = rng.uniform(-1.0, 1.0, (12, robot.dof))
    lengths = np.array([0.5, 0.7, 0.7, 2.0])
    return replace(
        robot, remainder=Remainder(Kernel((True,) * robot.dof, lengths), centres, rng.normal(0, 0.15, (12, 3)), 0.15)
    )


def measured(model: Model, rng: np.random.Generator, train: int = 150, test: int = 200) -> Dataset:
    """Poses within 1 rad of zero, with errors of 1 mm and 3 mrad."""
    names = [p for p in model.parameters.items if not p.unknown]
    truth = {p.name: rng.normal(0, 3e-3 if p.unit == "rad" else 0.5) for p in names}
    sets = [
        simulate(model, truth, rng.uniform(-1, 1, (count, model.robot.dof)), Noise(position=NOISE), rng, split)
        for split, count in (("train", train), ("test", test))
    ]
    return concatenate(*sets)


def tried(draw: int, robot: Robot | None = None, train: int = 150) -> tuple[Calibration, Calibration, Dataset]:
    """A simulated measurement identified without and with a remainder; that of ``robot``, else of the plain arm."""
    rng = np.random.default_rng([20260, draw])
    model = build_model(arm(), TASK)
    data = measured(model if robot is None else build_model(robot, TASK), rng, train)
    plain = calibrate(model, None, data, Options())
    return plain, with_remainder(plain, data, Options(), rng), data


if __name__ == "__main__":
    kept = 0
    for draw in range(int(sys.argv[1])):
        _, calibration, _ = tried(draw)
        assert calibration.trial is not None
        kept += calibration.trial.kept
        print(draw, calibration.trial.kept, f"{calibration.trial.candidate.gain:.2f}", flush=True)
    print(f"kept {kept} of {sys.argv[1]}")
