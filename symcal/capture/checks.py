"""Is this reading one that the robot can have given? Each is looked at when it comes in, by what the others foretell.

A reading is odd when its squared distance from what was foreseen, in standard deviations of both, is one that good
readings have with a probability below `ODD`. What may be the reason is tried out: another unit, marks that are
exchanged, the posture of another pose. Before everything can be placed only what no robot could give is told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.calibration.mistakes.hypotheses import Hypothesis, axis_hypotheses, frame_hypotheses, point_hypotheses
from symcal.calibration.outliers import outliers
from symcal.capture.aim import Aim
from symcal.capture.course import Reading
from symcal.capture.estimate import Estimate, chance, dataset, foreseen, whitened_rows
from symcal.placing.placement import stated
from symcal.units import SHOWN, SHOWN_UNITS
from symcal.words import number

Array = NDArray[np.float64]

ODD = 1e-4
"""Probability by chance from which on a reading is odd."""
SHARP = 4.0
"""Noises, in the direction in which it is foreseen worst, up to which a reading tells whether something has moved: a
shift by 25 of them is odd in 95 of 100 cases."""
_LIKELY = 0.01  # the same of a reading as it would be without a mistake that explains it
_STALE = 3  # numbers of a reading, at least, that are never the same twice by chance
_FEW_MARKS = 8  # of which two may be taken for each other; the corners of a board have numbers
_TWICE = 2.2  # times the arm's length: no two points of a tool are further apart


@dataclass(frozen=True, slots=True)
class Found:
    """What a check says of a reading.

    off: distance from where it was foreseen, in `unit`, and expected: how large that usually is; None while nothing can
    be foreseen. odd: why it should not count as it is; empty where it may. sharp: it was
    foreseen so well that it would have told if something had moved.
    """

    off: float | None = None
    unit: str = "mm"
    expected: float | None = None
    odd: str = ""
    sharp: bool = False


def check(aim: Aim, known: Estimate | None, reading: Reading, others: Sequence[Reading]) -> Found:
    """One reading against what the others let one expect.

    Args:
        known: of the others that count, without it. others: all that came before.
    """
    same = _stale(reading, others)
    if same:
        return Found(odd=same)
    if known is None:
        return Found(odd=_out_of_reach(aim, reading, others))
    data = dataset(aim, [reading])
    found = foreseen(aim, known, data)
    off, expected, unit = _shown(aim, found.r, np.diag(found.covariance))
    if chance(found.square, len(found.r)) >= ODD:
        return Found(off, unit, expected, sharp=found.largest <= SHARP)
    reason = _reason(aim, known, reading)
    said = f"{number(off)} {unit} from where the others put it, where {number(expected)} {unit} would be usual"
    return Found(off, unit, expected, f"{said}{f': it looks as if {reason}' if reason else ''}")


def agree(aim: Aim, known: Estimate | None, one: Reading, other: Reading) -> bool:
    """Whether two readings of one posture are the same but for noise."""
    return apart(aim, known, one, other)[0] >= ODD


def apart(aim: Aim, known: Estimate | None, one: Reading, other: Reading) -> tuple[float, float, str]:
    """Probability by chance of the difference of two readings of one posture, and its size with its unit."""
    noise = dict(aim.nominal) if known is None else dict(known.noise)
    before = other.z.copy()
    if aim.instrument.reads == "frame" and one.z[3:] @ before[3:] < 0:
        before[3:] *= -1  # the same attitude
    both = np.isfinite(one.z) & np.isfinite(before)
    difference = (one.z - before)[both]
    size, _, unit = _shown(aim, difference, np.ones(len(difference)))
    difference = difference / (np.sqrt(2.0) * _sigma_of_numbers(aim, noise)[both])
    return float(scipy.special.chdtrc(max(int(both.sum()), 1), float(difference @ difference))), size, unit


def _sigma_of_numbers(aim: Aim, noise: dict[str, float]) -> Array:
    """Standard deviation of every number of a reading, shape (w,): that of the quantity that it belongs to; of a
    quaternion half of a turn's."""
    group = {g.quantity: noise[g.name] for g in aim.model.measurement.groups}
    first, *more = aim.instrument.quantities
    sizes = [
        group[first.noise] if unit is not None else group[more[0].noise] / 2 if more else group[first.noise]
        for _, unit in aim.instrument.columns
    ]
    return np.tile(sizes, max(len(aim.observation.features), 1))


def odd_among(aim: Aim, known: Estimate, readings: Sequence[Reading]) -> tuple[Reading, ...]:
    """The readings that the others do not explain, whichever have drawn the estimate to them.

    Args:
        known: the estimate of these readings.
    """
    if known.fit.dof < 1:
        return ()
    listed = outliers(aim.model, known.data, known.fit, stated(aim.model, known.setup)).listed
    names = {each.pose for each in listed}
    return tuple(r for r, label in zip(readings, known.data.labels, strict=True) if label in names)


def off_by_now(aim: Aim, known: Estimate, readings: Sequence[Reading]) -> tuple[Reading, ...]:
    """Readings that counted and that the others, now that there are more, do not foretell; the worst first. Where all
    together are more than the noise, also the one without which they are not.

    Each is left out of the linearised fit: r^T (1 - H)^-1 r, as of `symcal.fit.deletion`.

    Args:
        known: the estimate of these readings.
    """
    if known.fit.dof < 1:
        return ()
    noise, covariance = known.noise, known.covariance
    if known.misfit is not None:  # at the noise as it is stated: a slip that counts makes the residuals of all larger
        noise, covariance = known.fit.sigmas, known.fit.posterior.covariance / np.outer(aim.scales, aim.scales)
    white, slopes = whitened_rows(aim, known, noise)
    found = []
    for reading, r, own in zip(readings, white, slopes, strict=True):
        seen = own.any(axis=1)
        left = np.eye(int(seen.sum())) - own[seen] @ covariance @ own[seen].T
        square = float(r[seen] @ np.linalg.solve(left, r[seen]))
        rest = max(known.fit.chi_squared - square, 0.0)
        alone = known.misfit is not None and chance(rest, max(known.fit.dof - len(left), 1.0)) >= _LIKELY
        if chance(square, len(left)) < ODD / len(readings) or alone:
            found.append((square, reading))
    return tuple(reading for _, reading in sorted(found, key=lambda each: -each[0]))


def _stale(reading: Reading, others: Sequence[Reading]) -> str:
    """Whether the instrument gave an old reading once more."""
    if np.isfinite(reading.z).sum() < _STALE:
        return ""
    for other in others:
        if np.array_equal(reading.z, other.z, equal_nan=True) and np.abs(reading.q - other.q).max() > 0:
            return f"the very numbers that were read at pose {other.pose}: the instrument has not read anew"
    return ""


def _out_of_reach(aim: Aim, reading: Reading, others: Sequence[Reading]) -> str:
    """What no arm of this size can have given, whatever its place: points further apart than it can reach."""
    if not (aim.instrument.gives_point and aim.instrument.reads == "points") or not others:
        return ""
    span = _TWICE * aim.model.robot.length_with_tool(reading.q[None])
    for other in others:
        distance = float(np.nanmax(np.linalg.norm((reading.z - other.z).reshape(-1, 3), axis=1)))
        if distance > span:
            return (
                f"{number(distance)} mm from what was read at pose {other.pose}, and the arm spans {number(span)} mm: "
                "is it in mm, and of the right mark?"
            )
    return ""


def _reason(aim: Aim, known: Estimate, reading: Reading) -> str:
    """What would make a reading a good one: the first of the mistakes that does; empty where none does."""
    for text, q, z in _mistakes(aim, reading):
        other = foreseen(aim, known, dataset(aim, [replace(reading, q=q, z=z)]))
        if chance(other.square, len(other.r)) >= _LIKELY:
            return text
    return ""


def _mistakes(aim: Aim, reading: Reading) -> Sequence[tuple[str, Array, Array]]:
    """What may be wrong with one reading: text, and joint readings and reading as they would be without it."""
    q, z = reading.q, reading.z
    of = {"points": point_hypotheses, "frame": frame_hypotheses, "axes": axis_hypotheses}[aim.instrument.reads]
    usual: tuple[Hypothesis, ...] = of() if aim.instrument.columns[0][0] == "x" else ()
    found = [(h.text, q, h.measured(z[None])[0]) for h in usual if h.measured is not None]
    names = aim.observation.features
    each = z.reshape(max(len(names), 1), -1)
    for i in range(len(names) if len(names) <= _FEW_MARKS else 0):
        for k in range(i):
            order = list(range(len(names)))
            order[i], order[k] = k, i
            found.append((f"{names[k]} and {names[i]} are exchanged", q, each[order].ravel()))
    for i in range(aim.planned):
        if np.abs(aim.poses[i] - q).max() > 0:
            found.append((f"the robot stood at pose {aim.names[i]}", aim.poses[i], z))
    return found


def _shown(aim: Aim, r: Array, variances: Array) -> tuple[float, float, str]:
    """Size of a residual as people are told it, how large it would usually be, and the unit: of the first quantity."""
    quantity = aim.instrument.quantities[0]
    size = min(quantity.size, len(r))
    shown = SHOWN[quantity.unit][1]
    own = r.reshape(-1, size)[0] if len(r) % size == 0 and len(aim.instrument.quantities) == 1 else r[:size]
    usual = float(np.sqrt(variances[: len(own)].sum()))
    return float(np.linalg.norm(own)) * shown, usual * shown, SHOWN_UNITS[quantity.unit]
