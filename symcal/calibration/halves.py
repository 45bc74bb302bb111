"""Two halves of the training poses, identified apart: whether they differ by no more than their uncertainties state.

Each half is identified with the model, the noise and the sizes of errors that the whole fit found; what they predict of
the tool in world is compared over the working area. The law of the difference is that of `symcal.fit.difference`. Of
several divisions, none of which knows what was measured (`symcal.calibration.divisions`), that by chance is told of
unless one differs by more than is stated and is less probable than the least of so many may be by chance ([Sidak1967]).
The idea is the cross-validation of [Kogan2023]; the law with a prior and the divisions are ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.apart import POSTURES, Apart, Compared, disagree, region_of
from symcal.calibration.calibrate import Calibration, one_thread
from symcal.calibration.divisions import Division, divisions
from symcal.calibration.thinned import thinned
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.difference import Difference, HalfRows, at_least_one, difference
from symcal.fit.estimation import Options, variance_model
from symcal.fit.given_variances import estimate_given
from symcal.fit.half_rows import half_rows
from symcal.fit.identifiability import numerical_rank
from symcal.fit.redundancy import check_redundancy
from symcal.fit.residual_rows import Rows, rows_of
from symcal.fit.robust import REDESCENDING
from symcal.fit.variances import Variances
from symcal.model.model import Model
from symcal.placing.placement import stated

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_HELD = 0.2  # weight of a reading below which it is a gross slip, far beyond any noise
_SLIPS = 0.1  # of the poses: more are no slips


@dataclass(frozen=True, slots=True)
class Halves:
    """Two halves compared; made by `two_halves`.

    division: that is told of, its halves identified. apart: what they predict. every: all divisions, by what they say
    to first order; that by chance is the first. by_area: postures are of a stated working area, otherwise within the
    ranges of the training poses. aside: training poses that are in neither half, as slips.
    """

    division: Division
    apart: Apart
    every: tuple[tuple[Division, Compared], ...]
    by_area: bool
    aside: int = 0

    @property
    def p(self) -> float:
        """Probability by chance of what the division that is told of says, as the least of all divisions."""
        return at_least_one(self.apart.compared.tested.p, len(self.every))

    @property
    def least(self) -> float:
        """Of the least probable division, its halves to first order."""
        return at_least_one(min(each.tested.p for _, each in self.every), len(self.every))

    @property
    def agree(self) -> bool:
        """They differ by no more than is stated, or by chance."""
        return not disagree(self.apart.compared, len(self.every))


def two_halves(
    calibration: Calibration,
    data: Dataset,
    options: Options,
    rng: np.random.Generator,
    area: tuple[Array, Array] | None = None,
) -> Halves:
    """Divide the training poses, identify each half, and compare what they predict.

    Args:
        data: all of them, in the order of the file; of very many a few thousand training poses are divided, evenly
            spread. options: of the identification. rng: draws halves and postures.
        area: lower and upper readings within which predictions are compared, shape (dof,) each; the ranges of the
            training poses if None.
    Raises:
        RefusedError: these data are not to be divided, and why.
    """
    with one_thread():
        return _two_halves(calibration, data, options, rng, area)


def _two_halves(
    calibration: Calibration,
    data: Dataset,
    options: Options,
    rng: np.random.Generator,
    area: tuple[Array, Array] | None,
) -> Halves:
    calibration, data = thinned(calibration, data)
    model, after, train = calibration.model, calibration.after, data.part("train")
    if not after.converged:
        raise RefusedError("the identification did not converge")
    if after.remainder is not None:
        raise RefusedError("a smooth remainder ties all poses together")
    kept = _without_slips(calibration, train)
    if not kept.all():
        train, after = train.take(kept), replace(after, weights=after.weights[kept])
        calibration = replace(calibration, after=after)
    rows = _rows(calibration, train)
    system = variance_model(rows, after.free, _options(calibration, options), prior_mean=_at(calibration))
    linear = half_rows(system, after.x, after.variances, after.estimated)
    lower, upper = (train.q.min(axis=0), train.q.max(axis=0)) if area is None else area
    q = rng.uniform(lower, upper, (POSTURES, model.robot.dof))
    region = region_of(model, calibration.setup, after.x, after.free, q)
    found: list[tuple[Division, Compared, Difference]] = []
    for division in _able(calibration, train, linear, divisions(train, _read(model, train), rng)):
        law = difference(linear, division.first)
        compared = region.to_first_order(law, law.step)
        if compared is not None:
            found.append((division, compared, law))
    if not found:
        raise RefusedError("the poses leave too little to tell the noise by")
    division, _, law = found[_told([compared for _, compared, _ in found])]
    first, second = (half_estimate(calibration, train, options, mask) for mask in (division.first, ~division.first))
    apart = region.apart(law, first, second)
    assert apart is not None  # it was something to first order
    every = tuple((each, compared) for each, compared, _ in found)
    return Halves(division, apart, every, area is not None, int(np.sum(~kept)))


def _without_slips(calibration: Calibration, train: Dataset) -> Mask:
    """Poses that are in the halves, shape (N,): a loss that lets gross slips pull leaves them out.

    The pull of a slip is bounded and not small; it is in one half and not in the other, so that the two differ by more
    than noise makes them (tried: 11 of 150 good sets with four slips of 20 noises in 60 poses). Losses that forget what
    is far off, and slips that are so many that they are none, stay as they are.
    """
    after = calibration.after
    if after.loss == "linear" or after.loss in REDESCENDING:
        return np.ones(len(train), dtype=np.bool_)
    seen = _rows(calibration, train).seen
    slips = np.asarray((seen & (after.weights < _HELD)).any(axis=1))
    return np.full(len(train), True) if slips.mean() > _SLIPS else ~slips


def _told(found: Sequence[Compared]) -> int:
    """Which division is told of: that by chance, the first, unless some disagree: then the least probable of these."""
    bad = [i for i, each in enumerate(found) if disagree(each, len(found))]
    return min(bad, key=lambda i: found[i].tested.p) if bad else 0


def _options(calibration: Calibration, options: Options) -> Options:
    """Those of the identification, with the loss that it chose."""
    return replace(options, loss=calibration.after.loss)


def _rows(calibration: Calibration, data: Dataset) -> Rows:
    model, unplaced = calibration.model, set(calibration.before.unplaced) - set(calibration.after.free)
    return rows_of(model.measurement, data, calibration.setup, model.residuals, unplaced)


def _at(calibration: Calibration) -> Array:
    return stated(calibration.model, calibration.setup)


def _read(model: Model, data: Dataset) -> Mask:
    """Which observations have read a pose, shape (N, o)."""
    return np.column_stack([part.seen(data.z).any(axis=1) for part in model.measurement.parts])


def _able(calibration: Calibration, train: Dataset, linear: HalfRows, found: Iterable[Division]) -> Iterator[Division]:
    """Divisions whose halves see as much each as those by chance do.

    Raises:
        RefusedError: a half by chance has no more equations than unknowns.
    """
    least = None
    for division in found:
        halves = (division.first, ~division.first)
        if least is None:
            for half in halves:
                _check_enough(calibration, train, half)
        ranks = [numerical_rank(linear.slopes[half[linear.pose]]) for half in halves]
        least = min(ranks) if least is None else least
        if min(ranks) >= least:
            yield division


def _check_enough(calibration: Calibration, train: Dataset, half: Mask) -> None:
    few = f"{len(train)} training poses are too few: a half of them would be"
    if not half.any():
        raise RefusedError(f"{few} none")
    try:
        check_redundancy(_rows(calibration, train.take(half)), calibration.after.free, estimated=True)
    except RefusedError:
        raise RefusedError(f"{few} {int(half.sum())}, which give no more equations than unknowns") from None


def half_estimate(calibration: Calibration, train: Dataset, options: Options, half: Mask) -> Array:
    """All parameters, shape (p,), from some of the training poses, with noise and sizes of errors of the whole fit.

    Args:
        half: which of the training poses, shape (N,).
    """
    after = calibration.after
    given = Variances(dict(after.sigmas), after.every_factor, after.weights[half])
    own = _options(calibration, options)
    rows = _rows(calibration, train.take(half))
    return estimate_given(rows, after.free, own, given, after.x, _at(calibration))[1]
