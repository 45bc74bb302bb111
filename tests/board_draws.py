"""The shipped eye in hand: one rendered set with partial views, then draws on image points with the noise found there.

    python tests/board_draws.py [draws]

Long form of the last test in test_board_runs.py. In every draw the truth of the link parameters is new, with their
plausible sizes; camera and intrinsics are as the camera's calibration knows them. Judged are the intervals of all link
parameters, and the error of the model's corners in the image against what was learnt from the data.
"""

# ruff: noqa: T201

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from symcal.calibration.simulate import simulate
from symcal.fit.estimation import Options, fit
from symcal.fit.residual_rows import rows_of
from symcal.images.rendered_boards import RenderedBoards, render_boards
from symcal.instruments.noise import Noise
from symcal.model.assembled import readings_kernel
from symcal.model.model import Model
from symcal.runs.load import load

CONFIG = Path(__file__).resolve().parent.parent / "configs" / "eye_in_hand_board.yaml"


@dataclass(frozen=True)
class Draws:
    """inside: whether each link parameter was in its 95 % interval, shape (draws, n). ratio: squared error of the
    corners in the image, over the noise, for every parameter's worth learnt; one for an unbiased estimate. noise:
    estimated, px. seen: share of the board's points in a view."""

    inside: np.ndarray
    ratio: np.ndarray
    noise: np.ndarray
    seen: float


def rendered(*overrides: str) -> RenderedBoards:
    experiment = load(CONFIG, overrides=overrides)
    rng = np.random.default_rng(experiment.seed)
    own = (experiment.file, experiment.file.data, experiment.document, experiment.model)
    return render_boards(*own, rng, lambda _: None)


def drawn(model: Model, q: np.ndarray, sigma: float, draws: int) -> Draws:
    parameters, names = model.parameters, model.kinematic
    index, free = parameters.indices(names), (*names, *model.placement)
    inside, ratio, noise, seen = [], [], [], []
    for draw in range(draws):
        rng = np.random.default_rng([draw, 41])
        truth = np.zeros(len(parameters))
        truth[index] = parameters.scales[index] * rng.normal(size=len(index))
        for prior in parameters.joint_priors:
            mean = np.zeros(len(prior.names))
            truth[parameters.indices(prior.names)] = rng.multivariate_normal(mean, prior.covariance)
        data = simulate(model, parameters.mapping(truth), q, Noise("normal", image=sigma), rng)
        found = fit(rows_of(model.measurement, data, model.setup, model.residuals), free, Options())
        assert found.converged, found.message
        read = np.isfinite(data.z)
        corners = readings_kernel(model.measurement, len(q))
        exact, fitted = (corners(q, x, model.setup.vector)[0] for x in (truth, found.x))
        learnt = found.equations - found.dof
        inside.append(np.abs(found.x - truth)[index] <= found.posterior.half_widths(0.95)[: len(names)])
        ratio.append(float(np.sum(((fitted - exact)[read] / sigma) ** 2)) / learnt)
        noise.append(found.sigmas[next(iter(found.sigmas))])
        seen.append(read.mean())
    return Draws(np.array(inside), np.array(ratio), np.array(noise), float(np.mean(seen)))


def main(draws: int) -> None:
    made = rendered()
    error = made.error_px[np.isfinite(made.error_px[..., 0])]
    sigma = float(np.sqrt(np.mean(error**2)))
    bias = np.abs(error.mean(axis=0)).max()
    print(f"rendered: {len(made.error_px)} images, {len(error)} corners, {sigma:.4f} px per axis, mean {bias:.4f} px")
    found = drawn(made.model, made.entry.data.q, sigma, draws)
    share = found.inside.mean(axis=0)
    off = found.ratio.std() / np.sqrt(draws)
    print(
        f"{draws} draws, {found.seen:.0%} of the corners in a view: 95 % intervals hold {share.mean():.4f} "
        f"({share.min():.2f} to {share.max():.2f}); squared error per parameter's worth {found.ratio.mean():.3f} "
        f"+- {off:.3f}; noise {found.noise.mean():.4f} px, {found.noise.std():.4f} from draw to draw"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
