"""What a trial comes to: errors at the test poses, what was foretold of them, and which stated intervals hold."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from symcal.trials.description import Cell, Description
from symcal.trials.draw import Drawn
from symcal.trials.identify import NORMAL_95, Estimate, Refusal
from symcal.trials.setting import Setting
from symcal.words import MOSTLY

Array = NDArray[np.float64]

OK, FAILED, REFUSED = "ok", "failed", "refused"
"""What became of a trial: its numbers count; it did not converge; it was refused, with a reason."""


FORETOLD = 250
"""Test poses at which the covariance is asked."""


@dataclass(frozen=True, slots=True)
class Result:
    """One trial, as it is kept. Errors are of the measured points at the test poses, mm.

    rank: directions seen. cost: what was minimised, where it is known. before_rms: of the nominal robot. mean, rms,
    p95, max: against the truth; measured_*: against readings with noise, where these were asked for.
    foretold_rms: what the covariance foretells at the first `FORETOLD` test poses; found_rms: the error there.
    probe: one component at one of these, another one in every trial, in units of its stated 95 % half width.
    intervals: a letter for each named parameter: I where the stated 95 % interval holds the true error, O where it does
    not; i and o where the data took less than half of the uncertainty away.
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
    foretold_rms: float | None = None
    found_rms: float | None = None
    probe: float | None = None
    intervals: str | None = None


COLUMNS: dict[str, type[int | float | str]] = {
    field.name: {"int": int, "float": float, "str": str}[str(field.type).partition(" ")[0]] for field in fields(Result)
}
"""What is kept of a trial, by name."""


def judge(
    description: Description,
    setting: Setting,
    cell: Cell,
    trials: list[int],
    drawn: Drawn,
    estimates: list[Estimate | Refusal],
) -> list[Result]:
    """The results of some trials of one cell, in their order."""
    at, before = np.empty(0), 0.0
    known: Array | None = None  # true errors whose positions these are: computed once where they do not change
    out = []
    for i, (trial, estimate) in enumerate(zip(trials, estimates, strict=True)):
        if isinstance(estimate, str):
            out.append(Result(trial, cell.number, REFUSED, estimate))
        elif not np.isfinite(estimate.x).all():
            out.append(Result(trial, cell.number, FAILED, "the identification gave no finite number"))
        else:
            x = drawn.truth[i]
            if known is None or (cell.drawn and not np.array_equal(known, x)):
                known = x
                at = setting.held_out_true(description.test, x, setting.true_model.setup.vector)[0]
                before = float(np.sqrt(_squares(setting.nominal - at).mean()))
            out.append(_judged(description, setting, cell, trial, drawn, i, estimate, at, before))
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
    before: float,
) -> Result:
    off = setting.held_out(description.test, estimate.x, estimate.setup)[0] - true
    errors = dict(zip(("mean", "rms", "p95", "max"), _statistics(off), strict=True))
    if description.measured:
        seen = _statistics(off - cell.noise.draw(cell.position_noise, off.shape, drawn.generators[i]))
        errors |= dict(zip(("measured_mean", "measured_rms", "measured_p95", "measured_max"), seen, strict=True))
    foretold, found, probe = _foretold(description, setting, estimate, off, trial)
    return Result(
        trial,
        cell.number,
        FAILED if estimate.trouble else OK,
        estimate.trouble,
        estimate.rank,
        estimate.iterations,
        None if np.isnan(estimate.cost) else estimate.cost,
        before,
        foretold_rms=foretold,
        found_rms=found,
        probe=probe,
        intervals=_intervals(setting, estimate, drawn.truth[i]),
        **errors,
    )


def _squares(off: Array) -> Array:
    """Squared lengths of vectors, shape (T, 3 k) -> (T k,)."""
    x, y, z = off.reshape(-1, 3).T
    return np.asarray(x * x + y * y + z * z)


def _statistics(off: Array) -> tuple[float, float, float, float]:
    """Mean, rms, 95th percentile (between its neighbours linearly) and maximum of the lengths of vectors (T, 3 k)."""
    squares = _squares(off)
    lengths = np.sqrt(squares)
    lengths.sort()
    count = len(lengths)
    place = 0.95 * (count - 1)
    low = int(place)
    high = min(low + 1, count - 1)
    p95 = lengths[low] + (place - low) * (lengths[high] - lengths[low])
    total, total_squares = np.add.reduce(lengths), np.add.reduce(squares)
    return float(total / count), float(np.sqrt(total_squares / count)), float(p95), float(lengths[-1])


def _foretold(
    description: Description, setting: Setting, estimate: Estimate, off: Array, trial: int
) -> tuple[float, float, float]:
    """Rms error over the first test poses that the covariance foretells, and that was found there, mm; and one
    component of the error over its stated half width.

    Linearised at the estimate: elsewhere other directions are unseen, and what is not known of those that are here
    would be taken for an error.
    """
    test, off = description.test[:FORETOLD], off[:FORETOLD]
    slopes = setting.slopes(test, estimate.x, estimate.setup)[0]
    if len(estimate.free) < slopes.shape[-1]:
        slopes = slopes[..., estimate.free]
    pose, component = divmod(trial % off.size, off.shape[1])
    points = off.size // 3
    found = float(np.sqrt(np.add.reduce(_squares(off)) / points))
    if estimate.posterior is not None:
        variance = np.add.reduce(estimate.posterior.predicted_rms(slopes) ** 2)
        half = float(estimate.posterior.prediction_half_widths(slopes[pose, component]))
    else:
        # squares of J R^-1: no difference of large numbers, as in J C J^T where much is unseen
        spread = slopes.reshape(off.size, -1) @ estimate.root
        own = spread[pose * off.shape[1] + component]
        variance, half = np.vdot(spread, spread), NORMAL_95 * float(np.sqrt(np.vdot(own, own)))
    error = float(off[pose, component])
    probe = error / half if half > 0 else np.copysign(np.inf, error) if error else 0.0
    return float(np.sqrt(variance / points)), found, probe


_LETTERS = np.array(["o", "i", "O", "I"])


def _intervals(setting: Setting, estimate: Estimate, truth: Array) -> str:
    place = np.full(len(estimate.x), -1)
    place[estimate.free] = np.arange(len(estimate.free))
    i = place[setting.judged]
    off = np.abs(estimate.x[setting.judged] - truth[setting.judged_true])
    learnt = 1 - np.diagonal(estimate.covariance)[i] / estimate.assumed[i] ** 2
    return "".join(_LETTERS[(off <= estimate.half_widths[i]) + 2 * (learnt >= MOSTLY)].tolist())
