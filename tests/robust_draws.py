"""Robust losses on a simulated six-axis arm: gross errors, or none, beside the linear fit of the clean data.

    python tests/robust_draws.py [draws [kind [share]]]        long form of test_robust.py

A tenth of the poses is off by 50 mm in random directions. Judged: rms distance to the truth at 300 unseen poses over
that of the linear fit of the same data without the gross errors; which poses are listed as outliers; how often
intervals of 95 % hold the truth.
"""

# ruff: noqa: T201

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace

import numpy as np
from few_poses import model_of, poses, somewhere

from symcal.calibration.identify import Calibration, calibrate
from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.model.model import Model

SIGMA, GROSS = 0.05, 50.0
UNSEEN = 300
COUNTS = (40, 60, 100)


@dataclass(frozen=True)
class Draw:
    """One robot, its clean measurements, the same with gross errors at ``wrong``, and exact ones at unseen poses."""

    model: Model
    clean: Dataset
    spoilt: Dataset
    exact: Dataset
    wrong: np.ndarray


def draw(seed: int, count: int, kind: str = "position", share: float = 0.1) -> Draw:
    rng = np.random.default_rng([seed, count, 41])
    model = model_of(kind)
    there = replace(model, setup=somewhere(model, rng))
    errors = {p.name: float(rng.normal() * p.scale) for p in model.parameters.items if p.name in model.kinematic}
    q = poses("independent", count + UNSEEN, rng)
    clean = simulate(there, errors, q[:count], Noise("normal", SIGMA, SIGMA / 200), rng)
    exact = simulate(there, errors, q[count:], Noise(), rng, "test")
    wrong = np.sort(rng.permutation(count)[: round(share * count)])
    way = rng.normal(size=(len(wrong), 3))
    z = clean.z.copy()
    z[wrong, :3] += GROSS * way / np.linalg.norm(way, axis=1)[:, None]
    return Draw(model, clean, replace(clean, z=z), exact, wrong)


def true_rms(case: Draw, found: Calibration) -> float:
    """Rms distance to the truth at the unseen poses, mm."""
    (error,) = case.model.accuracy(case.exact.q, found.after.x, found.setup.vector, case.exact.z)
    return float(np.sqrt(np.mean(np.sum(error[:, :3] ** 2, axis=1))))


def oracle(case: Draw) -> Dataset:
    return case.clean.take(np.setdiff1d(np.arange(len(case.clean)), case.wrong))


def main(draws: int, kind: str, share: float) -> None:
    losses = ["oracle", "huber", "cauchy", "tukey", "auto"]
    if len(sys.argv) > 4:
        losses = sys.argv[4].split(",")
    for count in COUNTS:
        ratios = {name: [] for name in losses}
        sig = {name: [] for name in losses}
        t = {name: 0.0 for name in losses}
        for seed in range(draws):
            case = draw(seed, count, kind, share)
            best = true_rms(case, calibrate(case.model, None, case.clean, Options()))
            for name in losses:
                t0 = time.perf_counter()
                found = (
                    calibrate(case.model, None, oracle(case), Options())
                    if name == "oracle"
                    else calibrate(case.model, None, case.spoilt, Options(loss=name))
                )
                t[name] += time.perf_counter() - t0
                ratios[name].append(true_rms(case, found) / best)
                sig[name].append(found.after.sigmas["position"] / SIGMA)
        for name in losses:
            r = np.array(ratios[name])
            print(
                f"{count} {name:8s} median {np.median(r):.3f} p90 {np.percentile(r, 90):.3f} max {r.max():.3f} "
                f"sigma {np.percentile(sig[name], [10, 50, 90]).round(3)} {t[name] / draws:.2f} s", flush=True
            )


if __name__ == "__main__":
    main(
        int(sys.argv[1]) if len(sys.argv) > 1 else 200,
        sys.argv[2] if len(sys.argv) > 2 else "position",
        float(sys.argv[3]) if len(sys.argv) > 3 else 0.1,
    )
