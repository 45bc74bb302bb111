"""Do intervals hold the truth as often as they say? Long form of test_coverage.py.

    python tests/interval_coverage.py [trials] [factor]

The truth of every link parameter is drawn anew in each trial, with the plausible size times ``factor``; the program is
told the plausible sizes. Every link parameter and every component of 20 predicted positions is judged by itself.
"""

# ruff: noqa: T201

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

import camera_scenes
import numpy as np
from few_poses import model_of, poses, somewhere
from scipy import stats

from symcal.calibration.evaluate import without_rigid_motion
from symcal.calibration.simulate import simulate
from symcal.fit.estimation import Options, fit
from symcal.fit.residual_rows import rows_of
from symcal.instruments.noise import Noise
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.placing.registration import rigid_fit

LEVELS = (0.68, 0.95)
KINDS = ("position", "pose", "pixels")
PREDICTED = 20


@dataclass(frozen=True)
class Coverage:
    """inside: by level, whether each of the judged quantities lay in its interval, shape (trials, quantities)."""

    names: tuple[str, ...]
    inside: dict[float, np.ndarray]

    def share(self, level: float) -> np.ndarray:
        return np.asarray(self.inside[level].mean(axis=0))

    def band(self, level: float) -> float:
        """Half width of the band that holds all shares together with 99 %, by Bonferroni over quantities and levels."""
        trials, count = self.inside[level].shape
        tail = 0.005 / (count * len(LEVELS))
        return float(stats.norm.isf(tail) * np.sqrt(level * (1 - level) / trials))


def setting(kind: str) -> tuple[Model, np.ndarray, np.ndarray, Noise]:
    """Model whose setup is the truth of every frame, poses measured, poses predicted, noise."""
    rng = np.random.default_rng(5)
    if kind == "pixels":
        model = camera_scenes.scene_model()
        q = camera_scenes.poses(model, 30 + PREDICTED, rng)
        return model, q[:30], q[30:], Noise("normal", image=0.05)
    q = poses("independent", 25 + PREDICTED, rng)
    model = model_of(kind)
    return replace(model, setup=somewhere(model, rng)), q[:25], q[25:], Noise("normal", 0.05, 2e-4)


def cover(kind: str, trials: int, factor: float = 1.0, options: Options = Options()) -> Coverage:
    model, train, asked, noise = setting(kind)
    parameters, names = model.parameters, model.kinematic
    index = parameters.indices(names)
    free = (*names, *model.placement)
    results: dict[float, list[np.ndarray]] = {level: [] for level in LEVELS}
    for trial in range(trials):
        rng = np.random.default_rng([trial, 77])
        truth = np.zeros(len(parameters))
        truth[index] = factor * parameters.scales[index] * rng.normal(size=len(index))
        for prior in parameters.joint_priors:  # a camera as its calibration knows it
            truth[parameters.indices(prior.names)] = rng.multivariate_normal(
                np.zeros(len(prior.names)), prior.covariance
            )
        data = simulate(model, parameters.mapping(truth), train, noise, rng)
        found = fit(rows_of(model.measurement, data, model.setup, model.residuals), free, options)
        off = np.abs(found.x - truth)[index]
        points, slopes = predicted(model, found.x, asked)
        exact, _ = predicted(model, truth, asked)
        if kind == "pixels":  # only the camera says where the world is: positions to one rigid motion of all of them
            laid = rigid_fit(points, exact)
            slopes = without_rigid_motion(points, slopes)
            points = points @ laid[:3, :3].T + laid[:3, 3]
        for level in LEVELS:
            widths = found.posterior.half_widths(level)[: len(names)]
            reach = found.posterior.prediction_half_widths(slopes[:, :, parameters.indices(free)], level)
            results[level].append(np.concatenate([off <= widths, (np.abs(points - exact) <= reach).ravel()]))
    labels = (*names, *(f"position {k} {axis}" for k in range(len(asked)) for axis in "xyz"))
    return Coverage(labels, {level: np.array(rows) for level, rows in results.items()})


def predicted(model: Model, x: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The tool, or its first point, in world, shape (N, 3), mm, and its Jacobian (N, 3, n)."""
    setup = model.setup.vector
    if model.points is not None:
        points, slopes = model.points(q, x, setup)
        return points[:, :3], slopes[:, :3]
    if model.task.observations[0].instrument.reads == "frame":
        frames, _, slopes = model.flange(q, x, Setup(model.setup.base, model.setup.tool).vector)
        return frames[:, :3, 3], slopes[:, :3]
    points, slopes = model.residual(q, x, setup, np.zeros((len(q), model.measurement.rows)))
    return points, slopes


def main(trials: int, factor: float) -> None:
    for kind in KINDS:
        found = cover(kind, trials, factor)
        for level in LEVELS:
            share = found.share(level)
            worst = int(np.abs(share - level).argmax())
            print(
                f"{kind}, {level:.0%}: {share.min():.3f} to {share.max():.3f}, mean {share.mean():.4f}; furthest "
                f"{found.names[worst]} {share[worst]:.3f}; band +-{found.band(level):.3f}; outside "
                f"{[found.names[i] for i in np.flatnonzero(np.abs(share - level) > found.band(level))]}"
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2000, float(sys.argv[2]) if len(sys.argv) > 2 else 1.0)
