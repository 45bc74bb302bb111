"""`loss: auto`: the loss that foretells held-out poses best, and the linear one unless another is clearly better.

Poses are left out fold by fold, every fold with all losses. The score of a pose is the log density of a Cauchy law with
the noise as its width, summed over its readings: what is far off counts about the same with every loss, so that gross
errors do not choose. Losses are compared pose by pose, with the standard error of the mean difference: the linear one
stands unless another is clearly better, then Cauchy's unless another is clearly better than that.

The folds are of the model linearised at the estimate of Tukey's loss: weights and estimate are found in turn there, the
variances held at those of two fits of all poses, one linear and one robust. Ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from dataclasses import replace as changed
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.calibration.outliers import outliers
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.deletion import Pile, readings_at
from symcal.fit.estimation import Fit, Options, fit
from symcal.fit.noise import known_sigma
from symcal.fit.residual_rows import Rows
from symcal.fit.robust import LOSSES, Loss, loss_weights, normal_median, tuning
from symcal.fit.whitened import whitened
from symcal.model.model import Model

Array = NDArray[np.float64]

FOLDS = 10
_CLEARLY = 3.0  # standard errors by which another loss must be better: folds share poses, so that two are too few
_TURNS = 50  # of weights and estimate
_SETTLED = 1e-4  # change of a weight that ends them


@dataclass(frozen=True, slots=True)
class LossChoice:
    """chosen: the loss. gain: by loss, by how much a held-out pose is foretold better than with the linear one, in log
    density, and the standard error of that. folds: how many. why: in a sentence."""

    chosen: Loss
    why: str
    folds: int = 0
    gain: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def facts(self) -> dict[str, Any]:
        """As plain data (results.json)."""
        return {
            "chosen": self.chosen,
            "why": self.why,
            "folds": self.folds,
            "gain": {name: {"mean": mean, "standard_error": error} for name, (mean, error) in self.gain.items()},
        }


def choose_loss(
    model: Model, data: Dataset, rows: Rows, free: tuple[str, ...], options: Options, prior_mean: Array
) -> LossChoice:
    """The loss for these training data.

    Args:
        rows: of the data at a setup. free: the parameters that are estimated.
    """
    linear = fit(rows, free, changed(options, loss="linear"), prior_mean=prior_mean)
    try:
        robust = fit(rows, free, changed(options, loss="tukey"), prior_mean=prior_mean)
    except RefusedError as error:
        return LossChoice("linear", f"robust losses were not possible: {error}")
    if not robust.converged:
        return LossChoice("linear", "a robust fit did not converge")
    scores, count = held_out_scores(rows, free, linear, robust, prior_mean)
    gain: dict[str, tuple[float, float]] = {loss: _gain(scores[loss], scores["linear"]) for loss in LOSSES[1:]}
    clear: list[Loss] = [loss for loss in LOSSES[1:] if gain[loss][0] > _CLEARLY * gain[loss][1]]
    if not clear:
        best = max(gain, key=lambda name: gain[name][0])
        return LossChoice(
            "linear", f"no other loss foretells held-out poses clearly better ({_said(best, gain)})", count, gain
        )
    crowds = outliers(model, data, robust, prior_mean).crowds
    if crowds:
        why = (
            f"{crowds[0].poses} of {crowds[0].of} poses would count as outliers in {crowds[0].group}: too many to be "
            "slips, so that the model lacks an effect, which a robust loss would hide"
        )
        return LossChoice("linear", why, count, gain)
    chosen = _best(clear, scores)
    return LossChoice(
        chosen, f"it foretells held-out poses clearly better than the linear one ({_said(chosen, gain)})", count, gain
    )


def _gain(one: Array, other: Array) -> tuple[float, float]:
    """Mean by which the first scores are better, pose by pose, and its standard error."""
    better = other - one
    return float(better.mean()), float(better.std(ddof=1) / np.sqrt(len(better)))


def _best(clear: list[Loss], scores: Mapping[Loss, Array]) -> Loss:
    """Cauchy's, which bears small slips and gross ones, unless another is clearly better than that."""
    if "cauchy" in clear:
        beside = {loss: _gain(scores[loss], scores["cauchy"]) for loss in clear if loss != "cauchy"}
        clear = [loss for loss, (mean, error) in beside.items() if mean > _CLEARLY * error] or ["cauchy"]
    return min(clear, key=lambda loss: float(scores[loss].mean()))


def _said(name: str, gain: Mapping[str, tuple[float, float]]) -> str:
    mean, error = gain[name]
    return f"{name}: log density per pose {mean:+.3g}, standard error {error:.2g}"


def held_out_scores(
    rows: Rows, free: tuple[str, ...], linear: Fit, robust: Fit, prior_mean: Array
) -> tuple[dict[Loss, Array], int]:
    """By loss minus the log density of every pose when it is held out, shape (N,), up to a constant; and the folds."""
    rows = rows.decorrelated()
    system = whitened(rows, free, np.zeros(len(robust.x)), prior_mean)
    stated = {name: sigma for name, sigma in robust.sigmas.items() if name not in robust.estimated}
    at = readings_at(system, robust.x, known_sigma(rows, stated), hold=True)
    given = list(at.piles)
    poses = np.flatnonzero(rows.seen.any(axis=1))
    count = min(FOLDS, len(poses))
    off: dict[Loss, list[Array]] = {}
    unscaled = at.white({pile.group.name: 1.0 for pile in given})
    for loss in LOSSES:
        own = linear if loss == "linear" else robust
        known = system.known_rows(robust.x, own.every_factor)
        white = at.white({pile.group.name: own.sigmas.get(pile.group.name, 1.0) for pile in given})
        found = [np.zeros(pile.seen.shape) for pile in given]
        for k in range(count):
            out = [np.isin(pile.pose, poses[k::count]) for pile in given]
            y = np.append(_estimate(loss, given, white, [~each for each in out], known), 1.0)
            for errors, plain, each in zip(found, unscaled, out, strict=True):
                errors[each] = plain[each] @ y
        off[loss] = found
    scores = {loss: np.zeros(len(rows.data)) for loss in LOSSES}
    for i, pile in enumerate(given):
        norms = {loss: np.linalg.norm(off[loss][i], axis=1) for loss in LOSSES}
        there, block = pile.there, pile.group.block
        size = min(float(np.median(norm[there])) for norm in norms.values()) / normal_median(block)
        width = max(size, pile.group.floor) * tuning("cauchy", block)
        for loss in LOSSES:
            # the Cauchy law of block dimensions: density (1 + t^2)^(-(d + 1) / 2)
            score = 0.5 * (block + 1) * np.log1p((norms[loss] / width) ** 2)
            np.add.at(scores[loss], pile.pose, np.where(there, score, 0.0))
    return {loss: each[poses] for loss, each in scores.items()}, count


def _estimate(loss: Loss, given: list[Pile], white: list[Array], kept: list[NDArray[np.bool_]], known: Array) -> Array:
    """The estimate y of the kept readings, shape (n,), for a loss whose weights are found in turn with it."""
    y = np.zeros(known.shape[1] - 1)
    last: list[Array] = []
    for _ in range(_TURNS):
        weights = [
            loss_weights(loss, np.linalg.norm(rows @ np.append(y, 1.0), axis=1), pile.group.block)
            for pile, rows in zip(given, white, strict=True)
        ]
        if last and max(float(np.abs(a - b).max(initial=0.0)) for a, b in zip(weights, last, strict=True)) < _SETTLED:
            break
        parts = [
            (rows * np.sqrt(w)[:, None, None])[own].reshape(-1, known.shape[1])
            for rows, w, own in zip(white, weights, kept, strict=True)
        ]
        triangle: Array = np.asarray(np.linalg.qr(np.vstack([*parts, known]), mode="r"), dtype=np.float64)
        y = -scipy.linalg.solve_triangular(triangle[: len(y), : len(y)], triangle[: len(y), len(y)])
        last = weights
    return y
