"""The robot as it stands after so many readings: the fit of an identification, begun where the last one ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.capture.aim import Aim
from symcal.capture.course import Reading
from symcal.data.dataset import Dataset, Readings
from symcal.errors import RefusedError
from symcal.fit.estimation import Fit, fit, variance_model
from symcal.fit.noise import known_sigma
from symcal.fit.residual_rows import Rows, rows_of
from symcal.fit.variances import Variances
from symcal.joints.backlash import direction_name
from symcal.model.measurement import Setup
from symcal.placing.placement import placed, placed_by, stated

Array = NDArray[np.float64]

SURE = 0.90
"""The noise is taken at the limit below which it lies with this probability, where it is estimated."""
UNLIKELY = 1e-3
"""Probability by chance of residuals so large at the stated noise, from which on they are more than that noise."""
_SURELY = 0.99  # probability with which at least so much is beyond the stated noise
_FEWEST = 4  # poses
_OVER = 3  # equations beyond the unknown frames with which everything is placed
_TO_TELL = 6  # equations beyond all unknowns from which noise is told; before, it is what the plan was made with
_PLACED_ANEW = 4  # poses for which places are sought anew; later they only move


@dataclass(frozen=True, slots=True)
class Misfit:
    """Residuals that are more than the stated noise: of a group, how many times, and the least rms of what is beyond it
    (its unit, over the components of a reading)."""

    group: str
    ratio: float
    beyond: float
    unit: str


@dataclass(frozen=True, slots=True)
class Estimate:
    """What is known after some readings; made by `estimate`.

    data: the readings that count. setup: where everything was placed, poses: how many there were then. noise: with
    which accuracy is foretold, by group: as stated, or its upper limit where it is estimated, or where residuals are
    larger than stated. covariance: of the scaled parameters at this noise, shape (p, p). misfit: None where residuals
    are as the stated noise.
    """

    data: Dataset
    fit: Fit
    setup: Setup
    placed_with: int
    noise: Mapping[str, float]
    covariance: Array
    misfit: Misfit | None

    @property
    def dof(self) -> float:
        return self.fit.dof


def dataset(aim: Aim, readings: Sequence[Reading]) -> Dataset:
    """Readings as an identification has them; a pose that was read again has a name of its own, such as `12 (2)`."""
    o = aim.observation
    width = len(o.instrument.columns) * max(len(o.features), 1)
    count = len(readings)
    conditions: dict[str, Array] = {}
    if aim.directed:
        came = np.array([reading.directions for reading in readings]).reshape(count, -1)
        conditions = {direction_name(i): column for i, column in enumerate(came.T, start=1)}
    return Dataset(
        of=(Readings(o.instrument, o.name, o.features),),
        q=np.array([reading.q for reading in readings]).reshape(count, aim.model.robot.dof),
        z=np.array([reading.z for reading in readings]).reshape(count, width),
        labels=labels(readings),
        split=tuple("train" if reading.standing in ("new", "taken") else "unused" for reading in readings),
        provenance="capture",
        conditions=conditions,
    )


def labels(readings: Sequence[Reading]) -> tuple[str, ...]:
    """A name for each, by its pose."""
    times: dict[str, int] = {}
    found = []
    for reading in readings:
        times[reading.pose] = times.get(reading.pose, 0) + 1
        found.append(reading.pose if times[reading.pose] == 1 else f"{reading.pose} ({times[reading.pose]})")
    return tuple(found)


def estimate(aim: Aim, data: Dataset, last: Estimate | None = None) -> Estimate | None:
    """The robot as these readings tell it; None while they are too few to place everything.

    Args:
        data: those that count. last: of almost the same data.
    """
    model = aim.model
    if len(data) < _FEWEST:
        return None
    free = placed_by(model, data)
    seen = sum(int(part.seen(data.z).sum()) for part in model.measurement.parts)
    if set(free) != set(model.placement) or seen < len(free) + _OVER:
        return None
    options = replace(aim.options, sigma={**aim.nominal, **aim.options.sigma})
    if last is None or last.placed_with < _PLACED_ANEW + _fewest(seen, len(data), len(free)):
        try:
            setup, with_, near = placed(model, data, options).setup, len(data), None
        except RefusedError:
            return None
    else:
        setup, with_, near = last.setup, last.placed_with, (last.fit.x, last.fit.variances)
    rows = rows_of(model.measurement, data, setup, model.residuals)
    telling = seen - len(aim.parameters) >= _TO_TELL
    if telling:
        options = aim.options
    at = stated(model, setup)
    try:
        found = fit(rows, aim.parameters, options, prior_mean=at, near=near)
    except RefusedError:
        return None
    misfit, noise = _noise(aim, found, told=telling)
    return Estimate(data, found, setup, with_, noise, _covariance(aim, found, rows, noise, at), misfit)


def _fewest(seen: int, poses: int, unknown: int) -> int:
    """Poses that are needed to place everything."""
    each = max(seen // max(poses, 1), 1)
    return -(-(unknown + _OVER) // each)


def _noise(aim: Aim, found: Fit, *, told: bool) -> tuple[Misfit | None, dict[str, float]]:
    """What is beyond the stated noise, and the noise to count with."""
    noise, misfit = dict(found.sigmas), None
    for group in aim.model.measurement.groups:
        squares, dof = found.by_group.get(group.name, (0.0, 0.0))
        if not dof > 1 or not told:
            continue
        limit = float(np.sqrt(squares / (2 * scipy.special.gammaincinv(dof / 2, 1 - SURE))))
        if group.name in found.estimated:
            noise[group.name] *= limit
        elif float(scipy.special.chdtrc(dof, squares)) < UNLIKELY:
            least = max(squares / (2 * scipy.special.gammaincinv(dof / 2, _SURELY)), 1.0)
            beyond = noise[group.name] * float(np.sqrt((least - 1) * group.block))
            misfit = Misfit(group.name, float(np.sqrt(squares / dof)), beyond, group.unit)
            noise[group.name] *= limit
    return misfit, noise


def _covariance(aim: Aim, found: Fit, rows: Rows, noise: Mapping[str, float], at: Array) -> Array:
    """Of the scaled parameters: the posterior's, with noise of this size."""
    own = np.asarray(found.posterior.covariance / np.outer(aim.scales, aim.scales))
    if dict(noise) == dict(found.sigmas):
        return own
    options = replace(aim.options, sigma=dict(noise))
    model = variance_model(rows, aim.parameters, options, prior_mean=at)
    given = Variances(dict(noise), found.every_factor, found.weights)
    jacobian = model.rows_with(given)(found.x)[:, :-1]
    root = np.linalg.inv(np.linalg.qr(jacobian, mode="r"))
    return np.asarray(root @ root.T)


@dataclass(frozen=True, slots=True)
class Foreseen:
    """A reading against what was foreseen of it: residual r, shape (m,), its covariance, shape (m, m), and the noise in
    it, shape (m,); components that were read alone."""

    r: Array
    covariance: Array
    sigma: Array

    @property
    def largest(self) -> float:
        """Standard deviation in the direction in which it is foreseen worst, in noises."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance / np.outer(self.sigma, self.sigma))[-1]))

    @property
    def square(self) -> float:
        """Squared distance in standard deviations."""
        return float(self.r @ np.linalg.solve(self.covariance, self.r))


def foreseen(aim: Aim, known: Estimate, data: Dataset) -> Foreseen:
    """One reading that is not among those of the estimate, against what these let one expect.

    Args:
        data: with this one pose.
    """
    rows = rows_of(aim.model.measurement, data, known.setup, aim.model.residuals)
    r, jacobian = rows(known.fit.x)
    sigma = known_sigma(rows, known.noise)[0]
    read = rows.seen[0]
    index = aim.model.parameters.indices(known.fit.free)
    slopes = jacobian[0][np.ix_(read, index)] * aim.scales
    return Foreseen(r[0][read], slopes @ known.covariance @ slopes.T + np.diag(sigma[read] ** 2), sigma[read])


def chance(square: float, count: float) -> float:
    """Probability that a good reading is so far off.

    Args:
        square: distance in standard deviations, squared. count: components of the reading.
    """
    return float(scipy.special.chdtrc(count, square))


def whitened_rows(aim: Aim, known: Estimate, noise: Mapping[str, float]) -> tuple[Array, Array]:
    """Residuals of the readings of an estimate over a noise by group, shape (N, m), and their slopes by the scaled
    parameters, shape (N, m, p); zero where nothing was read."""
    rows = rows_of(aim.model.measurement, known.data, known.setup, aim.model.residuals)
    r, jacobian = rows(known.fit.x)
    inverse = np.where(rows.seen, 1 / known_sigma(rows, noise), 0.0)
    index = aim.model.parameters.indices(aim.parameters)
    return r * inverse, jacobian[:, :, index] * aim.scales * inverse[:, :, None]
