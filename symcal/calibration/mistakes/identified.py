"""Mistakes of the joint columns told by whole identifications: for instruments whose readings give no point, and for
mistakes that are no larger than the errors of the nominal robot.

Each hypothesis has everything placed and identified anew, and is named where it leaves a quarter of what the data leave
as they are given. Only those are tried that nominal kinematics explains no worse than the data as given. A few seconds,
which is why only identifications are looked at that leave too much. The way is ours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.mistakes.hypotheses import Hypothesis, joint_hypotheses
from symcal.calibration.mistakes.mistake import Mistake, mistake_of
from symcal.calibration.mistakes.scene import AS_GIVEN, joint_readings, sessions_of, some
from symcal.data.dataset import Dataset
from symcal.errors import InputError, RefusedError
from symcal.fit.estimation import Options, fit
from symcal.fit.residual_rows import rows_of
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.placing.placement import place, placed_by, stated
from symcal.placing.registration import LEVER
from symcal.solvers.least_squares import Tolerances
from symcal.units import DEGREES, SHOWN_UNITS

Array = NDArray[np.float64]

_SINGLE = "signs, right-angle zeros, units and order of the joint columns and a shift by a row"
TRIED = f"{_SINGLE} were tried one by one: none explains it"
UNTRIED = f"{_SINGLE} were not tried one by one: the poses are too few"
"""What is said of the search where it has found nothing, and where it was none."""
_BETTER = 4.0  # times that a hypothesis must leave less than the data as given
_ALIKE = 2.0  # times the least: hypotheses that the data do not tell apart
_EXACT = 1e-6  # of what is left as given: rounding
_NO_WORSE = 1.1  # times what nominal kinematics leaves of the data as given
_SHARE = 8.0  # of what nominal kinematics leaves as given: a fit is asked for so much less
_POSES, _MOST, _TIMES = 40, 120, 3.0  # that are looked at; more where they have fewer numbers than so many unknowns
_STARTS = 6  # of searches for instruments: a place that none of them finds is a hypothesis not tried
_COARSE = Tolerances(cost=1e-4, iterations=40)  # a quarter is told by less than convergence
_SPARE = 5  # equations beyond all unknowns, at least


@dataclass(frozen=True, slots=True)
class _Left:
    """What is left of every group of readings, rms per component in its unit, and where everything was placed."""

    rms: Mapping[str, float]
    setup: Setup
    data: Dataset
    free: tuple[str, ...]


def told_by_identification(model: Model, data: Dataset) -> tuple[Mistake, ...] | None:
    """The single mistake of the joint columns, or the class of those, with which the data are identified far better;
    None where the data are too few to tell.

    Args:
        data: all poses, in the order of their file; those for training are looked at.
    """
    given = _by_nominal(model, data, AS_GIVEN)
    if given is None:
        return None
    sigma = {name: rms / _SHARE for name, rms in given.rms.items() if rms > 0}
    before = _by_identification(model, given, sigma)
    if before is None or not any(before.values()):
        return None
    tried: list[tuple[float, Hypothesis, Mapping[str, float]]] = []
    for hypothesis in joint_hypotheses(model.robot):
        start = _by_nominal(model, data, hypothesis)
        if start is None or _ratio(start.rms, given.rms) > _NO_WORSE:
            continue
        after = _by_identification(model, start, sigma)
        if after is not None:
            tried.append((_ratio(after, before), hypothesis, after))
    best = min((ratio for ratio, _, _ in tried), default=np.inf)
    if not best * _BETTER < 1:
        return ()
    limit = min(_ALIKE * best + _EXACT, 1 / _BETTER)
    kept = sorted((each for each in tried if each[0] <= limit), key=lambda each: each[0])
    _, first, after = kept[0]
    group = next(group for group in model.measurement.groups if before.get(group.name, 0.0) > 0)
    shown = float(np.sqrt(group.block)) * (DEGREES if group.unit == "rad" else 1.0)
    found = mistake_of(
        first.kind,
        tuple(hypothesis.text for _, hypothesis, _ in kept),
        shown * before[group.name],
        shown * after[group.name],
        SHOWN_UNITS[group.unit],
        "the identification",
    )
    return (found,)


def _by_nominal(model: Model, data: Dataset, hypothesis: Hypothesis) -> _Left | None:
    """What nominal kinematics leaves with everything placed; None where it cannot be placed, or poses are too few."""
    q, rows = joint_readings(data.q, sessions_of(data.labels), hypothesis)
    train = rows & np.array([split == "train" for split in data.split])
    if not train.any():
        return None
    unknowns = len(placed_by(model, data.take(np.flatnonzero(train)))) + len(model.kinematic)
    seen = sum(part.seen(data.z[train]).sum(axis=1).mean() for part in model.measurement.parts)
    own = replace(data, q=q).take(some(train, max(_POSES, min(_MOST, round(_TIMES * unknowns / max(seen, 1.0))))))
    free = placed_by(model, own)
    if sum(int(part.seen(own.z).sum()) for part in model.measurement.parts) < unknowns + _SPARE:
        return None
    try:
        setup = place(model, own, Options(sigma=_rough(model), tolerances=_COARSE), _STARTS)
    except (InputError, RefusedError, np.linalg.LinAlgError):
        return None
    rms = _rms(model, own, setup, np.zeros(len(model.parameters)))
    return _Left(rms, setup, own, free) if np.isfinite(list(rms.values())).all() else None


def _rough(model: Model) -> dict[str, float]:
    """Noise by group that places are found with: only the ratio of units matters."""
    return {group.name: 1 / LEVER if group.unit == "rad" else 1.0 for group in model.measurement.groups}


def _by_identification(model: Model, start: _Left, sigma: Mapping[str, float]) -> Mapping[str, float] | None:
    """What an identification leaves."""
    unplaced = set(model.placement) - set(start.free)
    rows = rows_of(model.measurement, start.data, start.setup, model.residuals, unplaced)
    options = Options(sigma=sigma, scales="stated", tolerances=_COARSE)
    try:
        found = fit(rows, (*model.kinematic, *start.free), options, prior_mean=stated(model, start.setup))
    except (InputError, RefusedError, np.linalg.LinAlgError):
        return None
    rms = _rms(model, start.data, start.setup, found.x)
    return rms if np.isfinite(list(rms.values())).all() else None


def _rms(model: Model, data: Dataset, setup: Setup, x: Array) -> dict[str, float]:
    rows = rows_of(model.measurement, data, setup, model.residuals)
    residual, out = rows.residual(x), {}
    for group in model.measurement.groups:
        own = list(group.columns)
        seen = rows.seen[:, own]
        if seen.any():
            out[group.name] = float(np.sqrt(np.mean(residual[:, own][seen] ** 2)))
    return out


def _ratio(rms: Mapping[str, float], given: Mapping[str, float]) -> float:
    """How much is left against what was, over all groups alike."""
    own: Sequence[float] = [rms[name] / value for name, value in given.items() if value > 0 and name in rms]
    return float(np.sqrt(np.mean(np.square(own)))) if own else 0.0
