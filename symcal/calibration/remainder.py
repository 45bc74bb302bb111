"""An identification with a smooth remainder on top: tried, proved on held-out poses, and kept or not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.compare import folds
from symcal.calibration.identify import Calibration, calibrated_robot, one_thread
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.correlated_rows import CorrelatedRows
from symcal.fit.estimation import Fit, Options, fit
from symcal.fit.remainder import Physics, Trial, best_candidate, trial
from symcal.fit.remainder_posterior import RemainderPosterior
from symcal.fit.residual_rows import Rows, rows_of
from symcal.joints.remainder import SHIFTS, TOLD, remainder_of
from symcal.model.model import Model, build_model
from symcal.model.shifted import with_shift
from symcal.placing.placement import stated
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

FOLDS = 5
FEWEST = 30
"""Training poses below which no remainder is looked for."""
_POSTURES = 2000
_A_TURN = 1e-9  # how far from a rotation slopes of a position by a displacement may be


def with_remainder(calibration: Calibration, data: Dataset, options: Options, rng: np.random.Generator) -> Calibration:
    """The calibration with a remainder where held-out poses are predicted better with one; else as it is.

    Either way `Calibration.trial` holds what was tried, and a note says what became of it.

    Args:
        data: what was identified with; its `train` split is used. rng: draws the folds.
    Raises:
        RefusedError: what is measured is neither points nor poses by one instrument with noise of one size, or the robot
        has a remainder already.
    """
    with one_thread():
        return _with_remainder(calibration, data, options, rng)


def _with_remainder(
    calibration: Calibration, data: Dataset, options: Options, rng: np.random.Generator
) -> Calibration:
    model, train = calibration.model, data.part("train")
    _check(model, train, options)
    physics = physics_of(calibration, train, options)
    candidate = best_candidate(physics)
    tried = trial(physics, candidate, folds(train, FOLDS, rng))
    if not tried.kept:
        return replace(calibration, trial=tried, notes=(*calibration.notes, said(tried)))
    field = physics.field(candidate.basis, np.arange(len(train)))
    own = physics.rows
    rows = CorrelatedRows(
        own.measurement,
        own.data,
        own.setup,
        own.kernels,
        own.poses,
        own.z,
        own.seen,
        unplaced=own.unplaced,
        displaced=field,
        ratio=candidate.ratio,
    )
    found = fit(rows, calibration.after.free, options, prior_mean=physics.at, nested=(calibration.after.x,))
    r, jacobian = own(found.x)
    remainder = remainder_of(
        candidate.kernel, candidate.centres, field.coefficients(-r, candidate.ratio), candidate.amplitude
    )
    slopes = field.coefficients(jacobian[:, :, model.parameters.indices(found.free)], candidate.ratio)
    posterior = RemainderPosterior(remainder, field.v, field.told(candidate.ratio), slopes)
    with_it = build_model(replace(model.robot, remainder=remainder), model.task)
    after = replace(found, remainder=posterior)
    return replace(
        calibration,
        model=with_it,
        bare=model,
        after=after,
        robot=calibrated_robot(with_it, after),
        trial=tried,
        notes=(*calibration.notes, said(tried)),
    )


def _check(model: Model, train: Dataset, options: Options) -> None:
    refused = "a remainder is found from positions or poses that one instrument measured with noise of one size"
    for problem, why in (
        (len(model.task.observations) > 1, "several instruments measured"),
        (options.loss != "linear", f"the loss is {options.loss}"),
        (train.sigma is not None and np.isfinite(train.sigma).any(), "the data state a noise for every measurement"),
        (train.covariance is not None, "the data state a covariance for every pose"),
        (len(train) < FEWEST, f"there are {len(train)} training poses, fewer than {FEWEST}"),
    ):
        if problem:
            raise RefusedError(f"{refused}, and {why}: leave out 'identification.remainder'")
    if model.robot.remainder is not None:
        raise RefusedError(
            "the robot has a remainder already: identify from the robot file it was made from, or leave out "
            "'identification.remainder'"
        )


def physics_of(calibration: Calibration, train: Dataset, options: Options) -> Physics:
    """A calibration linearised, with what a displacement of the flange does to it."""
    model, setup, after = calibration.model, calibration.setup, calibration.after
    shifted = with_shift(model)
    unplaced = tuple(name for name in model.placement if name not in after.free)
    rows = rows_of(model.measurement, train, setup, model.residuals, unplaced)
    r, jacobian = rows(after.x)
    columns, turns = _turns(rows_of(shifted.measurement, train, setup, shifted.residuals, unplaced), after)
    joints = model.robot.joints
    lower, upper = model.robot.ranges
    revolute = tuple(joint.revolute for joint in joints)
    at = stated(model, setup)
    return Physics(rows, r, jacobian, columns, turns, after, options, at, revolute, upper - lower)


def _turns(rows: Rows, after: Fit) -> tuple[NDArray[np.intp], Array]:
    """Columns of positions by point, (P, 3), and their slopes by the shift, (N, P, 3, 3)."""
    (own,) = (g for g in rows.measurement.groups if g.unit == "mm")
    columns = np.array(own.columns).reshape(-1, 3)
    _, jacobian = rows(np.concatenate([after.x, np.zeros(len(SHIFTS))]))
    turns = jacobian[:, columns, -len(SHIFTS) :]
    measured = rows.seen[:, columns].all(axis=2)
    off = np.abs(turns @ turns.swapaxes(-1, -2) - np.eye(3))[measured]
    if off.max(initial=0.0) > _A_TURN:
        raise RefusedError(
            "what is measured does not move with the flange: leave out 'identification.remainder'"
        )
    return columns, turns


def said(tried: Trial) -> str:
    """What became of a remainder, in a sentence."""
    rms = (float(np.sqrt(np.mean(each**2))) for each in (tried.without, tried.given))
    before, after = rms
    errors = tried.better / tried.standard_error if tried.standard_error > 0 else 0.0
    numbers = (
        f"held-out training poses were predicted to {after:.4f} mm rms with it and {before:.4f} mm without "
        f"({errors:.1f} standard errors of the paired differences)"
    )
    if tried.kept:
        return f"a smooth remainder was kept: {numbers}"
    return f"a smooth remainder was tried and not kept: {numbers}"


def outside(robot: Robot, rng: np.random.Generator, lower: Array | None = None, upper: Array | None = None) -> float:
    """Share of random postures, of the joint limits or of an area, at which the remainder's centres tell less than
    `TOLD` of its variance: there it is as good as zero.

    Raises:
        ValueError: the robot has no remainder.
    """
    if robot.remainder is None:
        raise ValueError("the robot has no remainder")
    limits = robot.ranges
    low, high = limits[0] if lower is None else lower, limits[1] if upper is None else upper
    q = rng.uniform(low, high, (_POSTURES, robot.dof))
    return float(np.mean(robot.remainder.told(q) < TOLD))
