"""Robust losses on a simulated six-axis arm: gross errors, or none, beside the linear fit of the clean data.

    python tests/robust_draws.py [draws [kind [share [losses]]]]        long form of test_robust.py

A tenth of the poses is off by 50 mm in random directions. Judged: rms distance to the truth at 300 unseen poses over
that of the linear fit of the same data without the gross errors; which poses are listed as outliers; how often
intervals of 95 % hold the truth.
"""

# ruff: noqa: T201

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from few_poses import model_of, poses, somewhere

from symcal.calibration.calibrate import Calibration, calibrate
from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.model.model import Model

SIGMA, GROSS = 0.05, 50.0
UNSEEN, INTERVALS = 300, 20
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


def without_gross(case: Draw) -> Dataset:
    return case.clean.take(np.setdiff1d(np.arange(len(case.clean)), case.wrong))


@dataclass(frozen=True)
class Judged:
    """ratio: rms to the truth over that of the linear fit of the clean data. missed: gross errors that are not listed;
    accused: good poses that are. inside: share of 95 % intervals of positions at 20 unseen poses that hold the truth.
    """

    ratio: float
    missed: int
    accused: int
    inside: float
    sigma: float
    loss: str


def judge(case: Draw, found: Calibration, best: float) -> Judged:
    listed = {int(each.pose) for each in found.outliers}
    wrong = {int(case.clean.labels[i]) for i in case.wrong}
    after, model, q = found.after, case.model, case.exact.q[:INTERVALS]
    _, slopes = model.points(q, after.x, found.setup.vector)
    reach = after.posterior.prediction_half_widths(slopes[:, :3, model.parameters.indices(after.free)])
    (error,) = model.accuracy(q, after.x, found.setup.vector, case.exact.z[:INTERVALS])
    return Judged(
        true_rms(case, found) / best,
        len(wrong - listed),
        len(listed - wrong),
        float(np.mean(np.abs(error[:, :3]) <= reach)),
        after.sigmas["position"] / SIGMA,
        after.loss,
    )


def judged(seed: int, count: int, kind: str, share: float, losses: Sequence[str]) -> dict[str, Judged]:
    """One draw by every loss; `without` is the linear fit without the gross errors, which nobody can do."""
    case = draw(seed, count, kind, share)
    best = true_rms(case, calibrate(case.model, None, case.clean, Options()))
    out = {}
    for name in losses:
        loss, data = ("linear", without_gross(case)) if name == "without" else (name, case.spoilt)
        found = calibrate(case.model, None, data, Options(loss=loss))  # type: ignore[arg-type]
        out[name] = judge(case if name != "without" else replace(case, wrong=case.wrong[:0]), found, best)
    return out


def summary(found: Sequence[Judged], count: int, share: float) -> str:
    ratios, gross = np.array([j.ratio for j in found]), round(share * count) * len(found)
    chosen = {loss: sum(j.loss == loss for j in found) for loss in dict.fromkeys(j.loss for j in found)}
    return (
        f"ratio median {np.median(ratios):.3f}, p90 {np.percentile(ratios, 90):.3f}, max {ratios.max():.3f}; "
        f"missed {sum(j.missed for j in found)} of {gross}; accused {sum(j.accused for j in found)} of "
        f"{count * len(found) - gross} in {sum(j.accused > 0 for j in found)} of {len(found)} sets; "
        f"95 % intervals {np.mean([j.inside for j in found]):.3f}; sigma {np.median([j.sigma for j in found]):.3f}; "
        f"{chosen}"
    )


def main(draws: int, kind: str, share: float, losses: Sequence[str]) -> None:
    for count in COUNTS:
        found = [judged(seed, count, kind, share, losses) for seed in range(draws)]
        for name in losses:
            print(f"{kind} {count} {share:.0%} {name}: {summary([f[name] for f in found], count, share)}", flush=True)


if __name__ == "__main__":
    main(
        int(sys.argv[1]) if len(sys.argv) > 1 else 200,
        sys.argv[2] if len(sys.argv) > 2 else "position",
        float(sys.argv[3]) if len(sys.argv) > 3 else 0.1,
        sys.argv[4].split(",") if len(sys.argv) > 4 else ("without", "linear", "huber", "cauchy", "tukey", "auto"),
    )
