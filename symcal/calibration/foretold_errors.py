"""Errors that are to be expected without measuring: of a robot that was never calibrated, and of one whose parameters
are known as well as an identification knows them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.evaluate import position_slopes
from symcal.calibration.evidence import Sizes
from symcal.calibration.tolerance import Of, taken_of
from symcal.data.dataset import evenly
from symcal.fit.estimation import Fit
from symcal.fit.posterior import predicted_rms
from symcal.model.model import Model, State
from symcal.parameters import SCALE

Array = NDArray[np.float64]

_DRAWS = 64


def uncalibrated(state: State, q: Array, noise_mm: float = 0.0, noise_deg: float = 0.0) -> Sizes:
    """Rms errors of a robot whose every parameter is as far off as is plausible, over poses q, shape (N, dof); of very
    many, a few thousand stand for all.

    Sizes of links that are stated smaller than the usual ones (`symcal.parameters.SCALE`) are taken as large as these:
    they say how good a robot is, not how bad one may be.

    Args:
        state: where things stand. noise_mm, noise_deg: of the measurement, as it is stated, rms over whole readings.
    """
    model, q = state.model, q[evenly(len(q))]
    index = model.parameters.indices(model.kinematic)
    if not index.size or len(q) == 0:
        return Sizes()
    links = model.robot.link_parameters
    usual = [SCALE[p.unit] if (p := model.parameters.items[i]).name in links else 0.0 for i in index]
    scales = np.maximum(model.parameters.scales[index], usual)
    slopes = model.points(q, state.x, state.setup.vector)[1][:, :, index] * scales
    turns = model.flange(q, state.x, state.setup.vector[:24])[2][:, 3:, index] * scales
    points = slopes.shape[1] // 3
    mm = float(np.sqrt(np.mean(np.sum(slopes**2, axis=(1, 2))) / points))
    deg = float(np.degrees(np.sqrt(np.mean(np.sum(turns**2, axis=(1, 2))))))
    return Sizes(float(np.hypot(mm, noise_mm)), float(np.hypot(deg, noise_deg)))


def open_errors(model: Model, fit: Fit, q: Array, of: Of) -> Sizes:
    """Errors of the tool that what the data do not tell lets expect over poses q, shape (N, dof), without noise.

    Parameters are drawn from the posterior, wider by as much as Student's t is than the normal law; the middle one of
    the draws' statistics is taken. Orientation is that of the tool frame in world.

    Args:
        of: the statistic over all poses and points.
    """
    if not fit.free or len(q) == 0:
        return Sizes(0.0, 0.0)
    values, vectors = np.linalg.eigh(fit.posterior.covariance)
    rng = np.random.default_rng(0)
    drawn = (vectors * np.sqrt(np.maximum(values, 0.0))) @ rng.standard_normal((len(values), _DRAWS))
    slopes, own = position_slopes(model, fit, q)
    index = model.parameters.indices(fit.free)
    turns = model.flange(q, fit.x, fit.setup.vector[:24])[2][:, 3:, index]
    if model.measurement.adrift:
        turns = turns - turns.mean(axis=0)
    moved = _drawn(slopes, drawn, fit)
    beside = rng.standard_normal(moved.shape) * np.sqrt(own / 3)[:, None, None, None]
    mm = np.linalg.norm(moved + beside, axis=2).reshape(-1, _DRAWS)
    deg = np.degrees(np.linalg.norm(_drawn(turns, drawn, fit), axis=2).reshape(-1, _DRAWS))
    return Sizes(*(float(np.median(taken_of(of, errors.T))) for errors in (mm, deg)))


def foremost(model: Model, fit: Fit, q: Array) -> str:
    """The parameter whose value, were it known, would take away most of what is open about the tool's position."""
    slopes = position_slopes(model, fit, q)[0]
    covariance = fit.posterior.covariance
    moved = np.sum((slopes.reshape(-1, len(covariance)) @ covariance) ** 2, axis=0)
    return fit.free[int(np.argmax(moved / np.maximum(np.diag(covariance), 1e-300)))]


def _drawn(slopes: Array, drawn: Array, fit: Fit) -> Array:
    """What drawn parameters (n, D) move, by slopes (N, 3 k, n): shape (N, k, 3, D)."""
    plain = predicted_rms(slopes, fit.posterior.covariance)
    wider = np.where(plain > 0, fit.posterior.predicted_rms(slopes) / np.where(plain > 0, plain, 1.0), 1.0)
    return np.asarray((slopes @ drawn * wider[:, None, None]).reshape(len(slopes), -1, 3, drawn.shape[1]))
