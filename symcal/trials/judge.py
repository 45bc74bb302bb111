"""What a trial comes to: errors at the test poses, what was foretold of them, and which stated intervals hold."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from symcal.fit.posterior import Posterior
from symcal.trials.description import Cell, Description
from symcal.trials.draw import Drawn
from symcal.trials.identify import NORMAL_95, Estimate
from symcal.trials.setting import Setting
from symcal.words import MOSTLY

Array = NDArray[np.float64]

OK, FAILED, REFUSED = "ok", "failed", "refused"
"""What became of a trial: its numbers count; it did not converge; it was refused, with a reason."""

_FORETOLD = 200  # test poses at which Student's laws foretell the error


@dataclass(frozen=True, slots=True)
class Result:
    """One trial, as it is kept. Errors are of the measured points at the test poses, mm.

    rank: directions seen. cost: what was minimised, where it is known. before_rms: of the nominal robot. mean, rms, p95,
    max: against the truth; measured_*: against readings with noise, where these were asked for. expected_rms: what the
    covariance foretells. probe: one component at one test pose, another one in every trial, in units of its stated
    95 % half width. intervals: a letter for each named parameter: I where the stated 95 % interval holds the true
    error, O where it does not; i and o where the data took less than half of the uncertainty away.
    """

    trial: int
    cell: int
    status: str
    reason: str
    rank: int | None = None
    iterations: int | None = None
    cost: float | None = None
    before_rms: float | None = None
    mean: float | None = None
    rms: float | None = None
    p95: float | None = None
    max: float | None = None
    measured_mean: float | None = None
    measured_rms: float | None = None
    measured_p95: float | None = None
    measured_max: float | None = None
    expected_rms: float | None = None
    probe: float | None = None
    intervals: str | None = None


COLUMNS = tuple(field.name for field in fields(Result))


@dataclass(slots=True)
class _Truth:
    """True positions at the test poses, by the true errors: computed once where these do not change."""

    setting: Setting
    test: Array
    x: Array | None = None
    at: Array | None = None

    def __call__(self, x: Array) -> Array:
        if self.at is None or self.x is None or not np.array_equal(self.x, x):
            self.x, self.at = x, self.setting.held_out_true(self.test, x, self.setting.true_model.setup.vector)[0]
        return self.at


def judge(
    description: Description,
    setting: Setting,
    cell: Cell,
    trials: list[int],
    drawn: Drawn,
    estimates: list[Estimate | None],
    refused: dict[int, str],
) -> list[Result]:
    """The results of some trials of one cell, in their order."""
    true_points = _Truth(setting, description.test)
    out = []
    for i, (trial, estimate) in enumerate(zip(trials, estimates, strict=True)):
        if estimate is None:
            out.append(Result(trial, cell.number, REFUSED, refused[i]))
        elif estimate.refused:
            out.append(Result(trial, cell.number, REFUSED, estimate.refused))
        elif not np.isfinite(estimate.x).all():
            out.append(Result(trial, cell.number, FAILED, "the identification gave no finite number"))
        else:
            at = true_points(drawn.truth[i])
            out.append(_judged(description, setting, cell, trial, drawn, i, estimate, at))
    return out


def _judged(
    description: Description,
    setting: Setting,
    cell: Cell,
    trial: int,
    drawn: Drawn,
    i: int,
    estimate: Estimate,
    true: Array,
) -> Result:
    found = setting.held_out(description.test, estimate.x, estimate.setup)[0]
    off = found - true
    mean, rms, p95, largest = _statistics(off)
    measured: tuple[float | None, ...] = (None,) * 4
    if description.measured:
        measured = _statistics(off - _noise(cell, off.shape, drawn.generators[i]))
    return Result(
        trial,
        cell.number,
        FAILED if estimate.trouble else OK,
        estimate.trouble,
        estimate.rank,
        estimate.iterations,
        None if np.isnan(estimate.cost) else estimate.cost,
        _statistics(setting.nominal - true)[1],
        mean,
        rms,
        p95,
        largest,
        *measured,
        _expected(setting, estimate),
        _probe(setting, estimate, off, trial),
        _intervals(setting, estimate, drawn.truth[i]),
    )


def _statistics(off: Array) -> tuple[float, float, float, float]:
    """Mean, rms, 95th percentile (between its neighbours linearly) and maximum of the lengths of vectors (T, 3 k)."""
    squares = np.square(off.reshape(-1, 3)).sum(axis=1)
    lengths = np.sort(np.sqrt(squares))
    place = 0.95 * (len(lengths) - 1)
    low = int(place)
    high = min(low + 1, len(lengths) - 1)
    p95 = lengths[low] + (place - low) * (lengths[high] - lengths[low])
    return float(lengths.mean()), float(np.sqrt(squares.mean())), float(p95), float(lengths[-1])


def _noise(cell: Cell, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Noise of positions that the test poses are measured with."""
    return cell.noise.draw(position_noise(cell), shape, rng)


def position_noise(cell: Cell) -> float:
    """Of positions, as the first instrument that has such noise states it; 0 without."""
    own = [cell.noise.by_instrument.get(name, {}).get("position", 0.0) for name in cell.instruments]
    return cell.noise.sizes.get("position", 0.0) or next((size for size in own if size), 0.0)


def _expected(setting: Setting, estimate: Estimate) -> float:
    """Rms error over the test poses that the covariance foretells, to first order."""
    if estimate.posterior is not None:
        slopes = setting.slopes[:_FORETOLD, :, estimate.free]
        points = slopes.shape[1] // 3
        return float(np.sqrt(np.mean(estimate.posterior.predicted_rms(slopes) ** 2) / points))
    weight = setting.weight[np.ix_(estimate.free, estimate.free)]
    return float(np.sqrt(max(np.einsum("ij,ij->", weight, estimate.covariance), 0.0)))


def _probe(setting: Setting, estimate: Estimate, off: Array, trial: int) -> float:
    """One component of the error over its stated half width."""
    pose, component = divmod(trial % off.size, off.shape[1])
    slope = setting.slopes[pose, component, estimate.free]
    half = _half_width(estimate.posterior, estimate.covariance, slope)
    return float(off[pose, component] / half) if half > 0 else 0.0


def _half_width(posterior: Posterior | None, covariance: Array, slope: Array) -> float:
    if posterior is not None:
        return float(posterior.prediction_half_widths(slope))
    return NORMAL_95 * float(np.sqrt(max(np.einsum("i,ij,j->", slope, covariance, slope), 0.0)))


def _intervals(setting: Setting, estimate: Estimate, truth: Array) -> str:
    model, true_model = setting.model, setting.true_model
    place = {int(index): i for i, index in enumerate(estimate.free)}
    letters = []
    for name in setting.named:
        index = model.parameters.index(name)
        i = place[index]
        off = abs(estimate.x[index] - truth[true_model.parameters.index(name)])
        share = 1 - estimate.covariance[i, i] / estimate.assumed[i] ** 2
        letter = "i" if off <= estimate.half_widths[i] else "o"
        letters.append(letter.upper() if share >= MOSTLY else letter)
    return "".join(letters)
