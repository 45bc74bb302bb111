"""Good sets that must raise no alarm, over random arms; long form of test_mistakes.py.

    python tests/mistake_draws.py [sets]         200 sets by default; prints how many were accused, and by what

Arms of five to seven axes, some prismatic, of 0.2 to 3 m, measured in position or pose from 15 to 60 poses over all or
a tenth of the joint ranges; nominal robots off by up to 20 mm rms, waves of the joints in them, noise of 0.05 to 2 mm.
"""

# ruff: noqa: T201

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

import numpy as np
from cases import QUARTER
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.calibration.calibrate import baseline_model, calibrate
from symcal.calibration.mistakes.search import find_mistakes
from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.robot.robot import Joint, Link, Robot

OFF = (1.0, 5.0, 20.0)  # mm rms of the nominal robot
_GROSS = ("check the order", "turned by", "not in the unit", "look as if")


@dataclass(frozen=True)
class Good:
    """A set without a mistake, and what was drawn."""

    model: Model
    data: Dataset
    said: str


def random_arm(rng: np.random.Generator) -> Robot:
    """Five to seven axes as industry turns them: right angles and parallel axes, one in four arms with a slide."""
    dof, size = int(rng.integers(5, 8)), float(np.exp(rng.uniform(np.log(200.0), np.log(3000.0))))
    slide = int(rng.integers(0, 3)) if rng.uniform() < 0.25 else -1
    links = []
    for i in range(dof):
        alpha = (
            float(rng.choice([QUARTER, -QUARTER, 0.0])) if 0 < i < dof - 2 else float(rng.choice([QUARTER, -QUARTER]))
        )
        long = i in (1, 2) or rng.uniform() < 0.2
        a = float(rng.uniform(0.2, 0.5) * size) if long else float(rng.choice([0.0, rng.uniform(0, 0.1) * size]))
        numbers = {"theta": 0.0, "d": float(rng.choice([0.0, rng.uniform(0.05, 0.4) * size])), "a": a, "alpha": alpha}
        if alpha == 0.0:
            numbers["beta"] = 0.0
        if i == slide:
            links.append(
                Link(Joint("prismatic", f"s{i}", 0.0, 0.6 * size), {"alpha": numbers["alpha"], "a": 0.0, "d": 0.0})
            )
        else:
            span = float(rng.uniform(1.5, 3.0))
            links.append(Link(Joint("revolute", f"r{i}", -span, span), numbers))
    tool = spatial.transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.1, 0.1, 3) * size)
    return Robot("drawn", "standard", tuple(links), np.eye(4), tool)


def good(seed: int) -> Good:
    rng = np.random.default_rng([seed, 77])
    robot = random_arm(rng)
    kind = "pose" if seed % 2 else "position"
    model = build_model(robot, Task.of(kind, frozenset({"base", "tool"})))  # type: ignore[arg-type]
    poses = int(rng.choice([15, 15, 25, 60]))
    share = float(rng.choice([0.1, 1.0]))
    middle = rng.uniform(
        robot.lower + share / 2 * (robot.upper - robot.lower), robot.upper - share / 2 * (robot.upper - robot.lower)
    )
    q = middle + share * (robot.upper - robot.lower) * rng.uniform(-0.5, 0.5, (poses, robot.dof))
    if rng.uniform() < 0.3:  # as a program visits them, neighbours near to each other
        q = q[np.argsort(q[:, 0])]
    noise = float(np.exp(rng.uniform(np.log(0.05), np.log(2.0))))
    off = float(rng.choice(OFF))
    data = measured(model, q, off, noise, rng)
    return Good(
        model, data, f"{robot.dof} axes, {kind}, {poses} poses, {share:.0%}, off {off} mm, noise {noise:.2f} mm"
    )


def measured(model: Model, q: np.ndarray, off: float, noise: float, rng: np.random.Generator) -> Dataset:
    """A robot off by so many mm rms with a fifth of it in waves of the joints, the instrument anywhere."""
    base = spatial.transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-2000, 2000, 3))
    there = replace(model, setup=replace(model.setup, base=base))
    sizes = {"mm": 1.0, "rad": 3e-3}
    errors = {p.name: float(rng.normal() * sizes[p.unit]) for p in model.parameters.items if p.name in model.kinematic}
    turning = np.array([joint.revolute for joint in model.robot.joints])
    wave = 6e-4 * turning * np.sin(rng.integers(1, 3, len(turning)) * q + rng.uniform(0, 6, len(turning)))

    def points(scale: float) -> np.ndarray:
        return np.asarray(
            model.points(
                q + scale * wave, model.parameters.vector({n: scale * v for n, v in errors.items()}), model.setup.vector
            )[0]
        )

    raw = float(np.sqrt(np.mean(np.sum((points(1.0) - points(0.0)).reshape(len(q), -1) ** 2, axis=1))))
    scale = off / raw
    true = {name: scale * value for name, value in errors.items()}
    data = simulate(there, true, q + scale * wave, Noise("normal", noise, noise / 200), rng)
    return replace(data, q=q)


def accused(case: Good, whole: bool = True) -> list[str]:
    """What is said of gross mistakes, by the search and (whole) by the identification."""
    found = [m.text for m in find_mistakes(case.model, case.data)]
    if whole:
        try:
            notes = calibrate(case.model, baseline_model(case.model), case.data, Options()).notes
        except RefusedError as error:
            return [*found, f"refused: {error}"]
        found += [note for note in notes if any(word in note for word in _GROSS) and note not in found]
    return found


def main(sets: int) -> None:
    alarms = 0
    for seed in range(sets):
        case = good(seed)
        said = accused(case)
        alarms += bool(said)
        if said:
            print(f"{seed}: {case.said}: {said}", flush=True)
    print(f"{alarms} of {sets} good sets accused")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
