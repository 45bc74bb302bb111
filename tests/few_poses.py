"""Identifications of a simulated six-axis arm from few poses, beside the best that truncation could do: long form.

    python tests/few_poses.py 500          prints the ratios over 500 sets; the short form is in test_few_poses.py

The witness is written here by itself: for every rank the Gauss-Newton solution on the leading singular directions with
the *true* noise, of which the truth then picks the best. Nobody can do that on real data.
"""

# ruff: noqa: T201

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from cases import QUARTER, revolute
from scipy.spatial.transform import Rotation
from scipy.stats import ortho_group

from symcal.calibration.calibrate import Calibration, calibrate
from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.model.measurement import Setup
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.robot.robot import Robot

SPECTRA = {
    "independent": None,
    "correlated": (70.0, 35.0, 23.0, 13.0, 8.0, 3.4),
    "narrow": (70.0, 26.0, 8.0, 3.0, 0.5, 0.06),
}
TEST_POSES = 60

# an industrial arm of six axes with an offset shoulder (standard convention)
INDUSTRIAL = Robot(
    "industrial",
    "standard",
    (
        revolute(3.0, theta=0.0, d=400.0, a=25.0, alpha=-QUARTER),
        revolute(3.0, theta=-QUARTER, d=0.0, a=455.0, alpha=0.0, beta=0.0),
        revolute(3.0, theta=0.0, d=0.0, a=35.0, alpha=-QUARTER),
        revolute(3.0, theta=0.0, d=420.0, a=0.0, alpha=QUARTER),
        revolute(3.0, theta=0.0, d=0.0, a=0.0, alpha=-QUARTER),
        revolute(3.0, theta=0.0, d=80.0, a=0.0, alpha=0.0),
    ),
)


@dataclass(frozen=True)
class Case:
    """One simulated set: model, measurements (train and test), true values of everything, noise per axis."""

    model: Model
    data: Dataset
    exact: Dataset
    truth: np.ndarray
    setup: Setup
    noise: Noise
    spectrum: str


@cache
def model_of(kind: str) -> Model:
    return build_model(INDUSTRIAL, Task.of(kind, frozenset({"base", "tool"})))  # type: ignore[arg-type]


def draw(seed: int) -> Case:
    """Position or pose, 15 to 40 poses, 0.02 to 0.2 mm, zero errors up to 2 deg, joints more or less correlated."""
    rng = np.random.default_rng(seed)
    spectrum = list(SPECTRA)[seed % 3]
    train = int(rng.integers(15, 41))
    size = float(np.exp(rng.uniform(np.log(0.02), np.log(0.2))))
    q = poses(spectrum, train + TEST_POSES, rng)
    return measured_at("position" if seed % 2 else "pose", q[:train], q[train:], size, rng, spectrum)


def measured_at(
    kind: str, q: np.ndarray, unseen: np.ndarray, size: float, rng: np.random.Generator, spectrum: str = ""
) -> Case:
    """An arm with random errors, its instrument anywhere, measured with noise at q and exactly at ``unseen``."""
    model = model_of(kind)
    noise = Noise("normal", size, size / 200)
    setup = somewhere(model, rng)
    zero = np.deg2rad(2.0) * rng.uniform()
    scale = float(np.exp(rng.uniform(np.log(0.1), 0.0)))
    errors = {}
    for p in model.parameters.items:
        if p.name in model.offsets:
            errors[p.name] = float(rng.uniform(-zero, zero))
        elif p.name in model.kinematic:
            errors[p.name] = float(rng.normal() * scale * p.scale)
    there = replace(model, setup=setup)
    measured = simulate(there, errors, q, noise, rng)
    exact = simulate(there, errors, unseen, Noise(), rng, "test")
    return Case(model, measured, exact, model.parameters.vector(errors), setup, noise, spectrum)


def poses(spectrum: str, count: int, rng: np.random.Generator) -> np.ndarray:
    """Joint readings about a bent arm; correlated ones have their spectrum (deg) in a random basis of the joints."""
    middle = np.array([0.0, 0.3, -0.3, 0.0, 0.6, 0.0]) + rng.uniform(-0.3, 0.3, 6)
    sizes = SPECTRA[spectrum]
    if sizes is None:
        return np.asarray(middle + rng.uniform(-1.2, 1.2, (count, 6)))
    basis = ortho_group.rvs(6, random_state=rng)
    return np.asarray(middle + rng.normal(size=(count, 6)) * np.deg2rad(sizes) @ basis.T)


def somewhere(model: Model, rng: np.random.Generator) -> Setup:
    """An instrument at any place and a tool that is roughly known."""
    base = np.eye(4)
    base[:3, :3] = Rotation.random(rng=rng).as_matrix()
    base[:3, 3] = rng.uniform(-2000, 2000, 3)
    tool = np.eye(4)
    tool[:3, :3] = Rotation.from_rotvec(rng.normal(size=3) * 0.2).as_matrix()
    tool[:3, 3] = rng.uniform(20, 150, 3)
    if model.task.observations[0].instrument.reads == "points":
        tool[:3, :3] = np.eye(3)
    return replace(model.setup, base=base, tool=tool)


def identified(case: Case, options: Options = Options()) -> Calibration:
    """Without the search for a mistake, which has tests of its own and takes seconds where it finds nothing."""
    return calibrate(case.model, None, case.data, options, mistakes=())


def true_rms(case: Case, setup: Setup, x: np.ndarray) -> float:
    """Rms distance to the truth at unseen poses of the same area, mm."""
    (error,) = case.model.accuracy(case.exact.q, x, setup.vector, case.exact.z)
    return float(np.sqrt(np.mean(np.sum(error[:, :3] ** 2, axis=1))))


def best_truncation(case: Case, setup: Setup) -> float:
    """The least error to the truth of all ranks, with the true noise, from the frames of the nominal robot."""
    model, data = case.model, case.data
    index = model.parameters.indices((*model.kinematic, *model.placement))
    scales = model.parameters.scales[index]
    sigma = np.tile(
        model.measurement.per_component(
            {"position": case.noise.sizes["position"], "orientation": case.noise.sizes["orientation"]}
        ),
        len(data),
    )

    def linear(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, jacobian = model.residual(data.q, x, setup.vector, data.z)
        return r.ravel() / sigma, jacobian.reshape(r.size, -1)[:, index] * scales / sigma[:, None]

    _, rows = linear(np.zeros(len(model.parameters)))
    best = np.inf
    for rank in range(6, min(rows.shape) + 1):
        x = np.zeros(len(model.parameters))
        for _ in range(6):
            r, rows = linear(x)
            u, s, vt = np.linalg.svd(rows, full_matrices=False)
            if s[rank - 1] < 1e-9 * s[0]:
                break
            wanted = rows @ (x[index] / scales) - r
            y = vt[:rank].T @ ((u[:, :rank].T @ wanted) / s[:rank])
            step, x[index] = np.abs(y - x[index] / scales).max(), scales * y
            if not np.isfinite(x).all() or np.abs(y).max() > 1e4 or step < 1e-6:
                break
        if np.isfinite(x).all() and np.abs(x[index] / scales).max() < 1e4:
            best = min(best, true_rms(case, setup, x))
    return best


def summary(ratios: np.ndarray) -> str:
    median, p90, p99 = np.percentile(ratios, [50, 90, 99])
    return (
        f"median {median:.3f}, p90 {p90:.3f}, p99 {p99:.3f}, max {ratios.max():.3f}, above 2: {np.mean(ratios > 2):.1%}"
    )


def main(count: int) -> None:
    ratios: dict[str, list[float]] = {name: [] for name in SPECTRA}
    chi, unsettled, factors = [], 0, []
    for seed in range(count):
        case = draw(seed)
        found = identified(case)
        unsettled += not found.after.converged
        ratio = true_rms(case, found.setup, found.after.x) / best_truncation(case, found.setup)
        ratios[case.spectrum].append(ratio)
        chi.append((found.after.sigmas["position"] / case.noise.sizes["position"]) ** 2)
        factors.append(found.after.factor)
        if ratio > 2:
            print(
                f"seed {seed} {case.spectrum} {case.model.task.observations[0].name} {len(case.data)} poses: "
                f"{ratio:.2f} factor {found.after.factor:.2f} sigma "
                f"{found.after.sigmas['position']:.3f}/{case.noise.sizes['position']:.3f}"
            )
    print("all:", summary(np.array([r for each in ratios.values() for r in each])), f"; did not converge: {unsettled}")
    for name, each in ratios.items():
        print(f"{name}: {summary(np.array(each))}")
    print("sigma^2 over true, percentiles 1 10 50 90 99:", np.percentile(chi, [1, 10, 50, 90, 99]).round(3))
    print("factor", np.percentile(factors, [1, 10, 50, 90, 99]).round(3))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500)
