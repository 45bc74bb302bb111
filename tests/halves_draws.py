"""Two halves of many drawn identifications: they differ as often as is stated, and where something is planted, nearly
always.

    python tests/halves_draws.py [draws [cases]]      long form of test_halves.py: 200 draws of each case

What is planted is planted in NumPy: the robot is simulated at other readings than the data say (`model_check_draws`).
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from cases import ARM, handling, prismatic, revolute
from model_check_draws import NOISE, SCENES, Plant, measured_scene, model_of, only, positioner, sag, wave
from numpy.typing import NDArray
from scipy import stats
from strategies import random_frame

from symcal.calibration.again import Again, calibrated_again
from symcal.calibration.apart import LEVEL
from symcal.calibration.calibrate import calibrate
from symcal.calibration.halves import Halves, two_halves
from symcal.calibration.record import recorded_task
from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.model.model import Model
from symcal.robot.robot import Robot

Array = NDArray[np.float64]
LINEAR = Options()
Draw = Callable[[np.random.Generator], Halves]
NewDraw = Callable[[np.random.Generator], Again]


@dataclass(frozen=True, slots=True)
class Case:
    """A robot of drawn errors, measured.

    sizes: of the errors of links, shares of the plausible ones. planted: what joints move by beyond their readings.
    lost: share of the readings of points that are missing; one of every pose is there.
    """

    model: Model
    count: int
    sizes: float = 0.3
    planted: Plant | None = None
    shaky: float = 0.0
    options: Options = LINEAR
    share: float = 1.0
    slips: int = 0
    lost: float = 0.0

    def __call__(self, rng: np.random.Generator) -> Halves:
        data = self.measured(self.truth(rng), self.count, rng)
        return two_halves(calibrate(self.model, None, data, self.options), data, self.options, rng)

    def truth(self, rng: np.random.Generator) -> tuple[Model, dict[str, float]]:
        """The model where its base truly is, and true errors."""
        true = replace(self.model, setup=replace(self.model.setup, base=random_frame(rng, 2000.0)))
        links = self.model.robot.parameters
        drawn = [(p.name, rng.normal() * p.scale) for p in self.model.parameters.items]
        return true, {name: float(e) * (self.sizes if name in links else 1.0) for name, e in drawn}

    def measured(
        self, truth: tuple[Model, dict[str, float]], count: int, rng: np.random.Generator, noise: float = NOISE
    ) -> Dataset:
        robot = self.model.robot
        lower, upper = robot.ranges
        middle, half = (upper + lower) / 2, (upper - lower) / 2
        q = middle + self.share * half * rng.uniform(-1, 1, (count, robot.dof))
        moved = q if self.planted is None else q + self.planted(q, rng)
        moved = moved + self.shaky * rng.normal(size=q.shape)
        data = simulate(*truth, moved, Noise("normal", noise, noise * 2e-3), rng)
        z = data.z.copy()
        z[rng.permutation(count)[: self.slips], :3] += rng.normal(size=(self.slips, 3))
        for start in range(0, z.shape[1], 3):  # at least one point of every pose stays
            if start or z.shape[1] > 3:
                lost = rng.random(count) < self.lost
                z[lost & np.isfinite(np.delete(z, np.s_[start : start + 3], 1)).any(axis=1), start : start + 3] = np.nan
        return replace(data, q=q, z=z)


@dataclass(frozen=True, slots=True)
class Second:
    """A robot calibrated, and measured again.

    count: new poses. elsewhere: share of the ranges that they are in. noise: of them, mm. bent: error that the robot
    got in between, in plausible sizes.
    """

    first: Case
    count: int
    elsewhere: float = 1.0
    noise: float = NOISE
    bent: float = 0.0

    def __call__(self, rng: np.random.Generator) -> Again:
        true, errors = self.first.truth(rng)
        data = self.first.measured((true, errors), self.first.count, rng)
        found = calibrate(self.first.model, None, data, self.first.options).robot
        assert found.record is not None
        links = self.first.model.robot.parameters
        scales = {p.name: p.scale for p in self.first.model.parameters.items}
        errors = {n: e + self.bent * scales[n] * rng.normal() * (n in links) for n, e in errors.items()}
        new = replace(self.first, share=self.elsewhere).measured((true, errors), self.count, rng, self.noise)
        task = recorded_task(found.record.provenance, "before", Path("calibrated.yaml"))
        return calibrated_again(found, task, new, rng)


def scene(name: str, rng: np.random.Generator) -> Halves:
    model, data = measured_scene(name, rng)
    return two_halves(calibrate(model, None, data, LINEAR), data, LINEAR, rng)


def scara() -> Robot:
    """Two turning joints, one that lifts, and one that turns the tool, all vertical."""
    links = (
        revolute(theta=0.0, d=300.0),
        revolute(alpha=0.0, a=350.0, beta=0.0, theta=0.0),
        prismatic(alpha=np.pi, a=250.0, beta=0.0, theta=0.0, d=0.0),
        revolute(alpha=0.0, a=0.0, beta=0.0, theta=0.0),
    )
    tool = np.eye(4)
    tool[:3, 3] = [60.0, 20.0, 80.0]
    return Robot("scara", "craig", links, tool=tool)


def twice(q: Array, rng: np.random.Generator) -> Array:
    """Half a mrad, twice to a turn of joint 2."""
    return only(2, 0.5e-3 * np.sin(2 * q[:, 1] + rng.uniform(-np.pi, np.pi)))


GOOD: dict[str, Draw] = {
    "position": Case(model_of(ARM, "position"), 50),
    "position, sizes as stated": Case(model_of(ARM, "position"), 50, sizes=1.0),
    "position, 30 poses": Case(model_of(ARM, "position"), 30),
    "position, narrow": Case(model_of(ARM, "position"), 60, share=0.1),
    "position, noise stated": Case(model_of(ARM, "position"), 50, options=Options(sigma={"position": NOISE})),
    "position, huber": Case(model_of(ARM, "position"), 50, options=Options(loss="huber")),
    "position, huber, slips": Case(model_of(ARM, "position"), 60, options=Options(loss="huber"), slips=4),
    "position, tukey, slips": Case(model_of(ARM, "position"), 60, options=Options(loss="tukey"), slips=4),
    "three points": Case(model_of(ARM, "position", 3), 40),
    "pose": Case(model_of(ARM, "pose"), 40),
    "pose, sizes as stated": Case(model_of(ARM, "pose"), 40, sizes=1.0),
    "pose, 15 poses": Case(model_of(ARM, "pose"), 15),
    "positioner": Case(model_of(positioner(), "pose"), 40),
    "handling": Case(model_of(handling(), "position"), 40),
    "scara": Case(model_of(scara(), "position"), 40),
    "scara, pose, 15 poses": Case(model_of(scara(), "pose"), 15),
    "three points, readings lost": Case(model_of(ARM, "position", 3), 30, lost=0.4),
    **{
        name: lambda rng, name=name: scene(name, rng)
        for name in (
            "tracker_and_wire",
            "two_trackers",
            *SCENES,
        )
    },
}
PLANTED: dict[str, Draw] = {
    "wave": Case(model_of(ARM, "position"), 60, planted=wave),
    "wave, pose": Case(model_of(ARM, "pose"), 50, planted=wave),
    "wave, twice to a turn": Case(model_of(ARM, "position"), 60, planted=twice),
    "sag": Case(model_of(ARM, "position"), 60, planted=sag),
    "three points, joints shake": Case(model_of(ARM, "position", 3), 60, shaky=1e-4),
}


POSES_60 = Case(model_of(ARM, "position"), 60)
AGAIN: dict[str, NewDraw] = {
    "again, position": Second(POSES_60, 40),
    "again, position, elsewhere": Second(POSES_60, 40, elsewhere=0.4),
    "again, position, other noise": Second(POSES_60, 40, noise=3 * NOISE),
    "again, position, huber": Second(replace(POSES_60, options=Options(loss="huber")), 40),
    "again, position, huber, slips": Second(replace(POSES_60, options=Options(loss="huber"), slips=3), 40),
    "again, scara": Second(Case(model_of(scara(), "position"), 40), 30),
    "again, pose": Second(Case(model_of(ARM, "pose"), 40), 30),
    "again, positioner": Second(Case(model_of(positioner(), "pose"), 40), 30),
    "again, handling": Second(Case(model_of(handling(), "position"), 40), 30),
}
BENT: dict[str, NewDraw] = {"again, bent": Second(POSES_60, 40, bent=0.03)}


def draws(case: str, count: int, seed: int = 0) -> list[Halves]:
    made = (PLANTED | GOOD)[case]
    found: list[Halves] = []
    for i in range(count):
        try:
            found.append(made(np.random.default_rng([seed, i])))
        except RefusedError as error:
            sys.stdout.write(f"  {case} {i}: {error}\n")
    return found


def by_chance(found: list[Halves]) -> Array:
    """p of the halves by chance, one of each draw."""
    return np.array([each.every[0][1].tested.p for each in found])


def told_of(found: list[Halves], case: str) -> str:
    """A line of numbers."""
    if not found:
        return f"{case}: none"
    p, least = by_chance(found), np.array([each.least for each in found])
    share = np.mean([each.apart.within for each in found])
    squares = [each.every[0][1].ratio ** 2 for each in found]
    bad = [each for each in found if not each.agree]
    ratios = [each.apart.compared.ratio for each in bad]
    pooled = np.array([compared.tested.p for each in found for _, compared in each.every])
    return (
        f"{case}: by chance p < 0.05 {np.mean(p < 0.05):.3f}, < 0.01 {np.mean(p < 0.01):.3f}, KS "
        f"{stats.kstest(p, 'uniform').pvalue:.3f}; all divisions < 0.05 {np.mean(pooled < 0.05):.3f}, < 0.01 "
        f"{np.mean(pooled < 0.01):.4f}; least of "
        f"{np.mean([len(each.every) for each in found]):.1f} < 0.05 {np.mean(least < 0.05):.3f}, < {LEVEL} "
        f"{len(bad)} of {len(found)}; rms ratio by chance {np.sqrt(np.mean(squares)):.3f}; within 95 % {share:.3f}; "
        f"r {np.mean([each.every[0][1].tested.directions for each in found]):.1f}"
        + (
            f"; flagged by {dict(Counter(each.division.name for each in bad))}, ratio median {np.median(ratios):.2f}"
            if bad
            else ""
        )
    )


def again(case: str, count: int, seed: int = 0) -> list[Again]:
    return [(AGAIN | BENT)[case](np.random.default_rng([seed, i])) for i in range(count)]


def told_again(found: list[Again], case: str) -> str:
    """A line of numbers."""
    p = np.array([each.p for each in found])
    ratios = np.array([each.apart.compared.ratio for each in found])
    return (
        f"{case}: p < 0.05 {np.mean(p < 0.05):.3f}, < 0.01 {np.mean(p < 0.01):.3f}, KS "
        f"{stats.kstest(p, 'uniform').pvalue:.3f}; {sum(not each.agree for each in found)} of {len(found)} differ; "
        f"rms ratio {np.sqrt(np.mean(ratios**2)):.3f}; within 95 % {np.mean([each.apart.within for each in found]):.3f}"
    )


if __name__ == "__main__":
    wanted = sys.argv[2:] or [*PLANTED, *GOOD, *BENT, *AGAIN]
    for name in wanted:
        many = int(sys.argv[1]) if len(sys.argv) > 1 else 200
        new = name in AGAIN or name in BENT
        sys.stdout.write((told_again(again(name, many), name) if new else told_of(draws(name, many), name)) + "\n")
        sys.stdout.flush()
