"""An identification with a smooth remainder on top: tried, proved on held-out poses, and kept or not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration, calibrated_robot, one_thread
from symcal.calibration.compare import Refine, as_it_is, folds
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.correlated_rows import correlated, field_of
from symcal.fit.estimation import Fit, Options, fit
from symcal.fit.remainder import Candidate, Physics, Trial, candidate_of, trial
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
        RefusedError: what is measured is neither points nor poses by one instrument with noise of one size, there are
        few poses, or the robot has a remainder already.
    """
    with one_thread():
        return _with_remainder(calibration, data, options, rng)


def _with_remainder(calibration: Calibration, data: Dataset, options: Options, rng: np.random.Generator) -> Calibration:
    model, train = calibration.model, data.part("train")
    _check(model, train, options)
    physics = physics_of(calibration, train, options)
    tried = trial(physics, folds(train, FOLDS, rng))
    out = _added(calibration, physics, tried.candidate) if tried.kept else calibration
    return replace(out, trial=tried, notes=(*out.notes, said(tried)))


def refined(calibration: Calibration, options: Options) -> Refine:
    """What cross-validation does with each fold's calibration: adds a remainder of the same length scales if one was
    kept."""
    tried = calibration.trial
    if tried is None or not tried.kept:
        return as_it_is

    def refine(own: Calibration, data: Dataset) -> Calibration:
        with one_thread():
            physics = physics_of(own, data.part("train"), options)
            return _added(own, physics, candidate_of(physics, tried.candidate.kernel))

    return refine


def _added(calibration: Calibration, physics: Physics, candidate: Candidate) -> Calibration:
    """The calibration with a remainder: estimated together, and then the field at the estimate."""
    model, ratio = calibration.model, candidate.ratio
    found = fit(
        correlated(physics.rows, candidate.field, ratio),
        calibration.after.free,
        physics.options,
        prior_mean=physics.at,
        nested=(calibration.after.x,),
    )
    at = physics_of(replace(calibration, after=found), physics.rows.data, physics.options)
    field = field_of(at.columns, at.turns, candidate.kernel.basis(at.rows.data.q, candidate.centres))
    coefficients = field.coefficients(-at.r, ratio)
    remainder = remainder_of(candidate.kernel, candidate.centres, coefficients, candidate.amplitude)
    slopes = field.coefficients(at.jacobian[:, :, model.parameters.indices(found.free)], ratio)
    after = replace(found, remainder=RemainderPosterior(remainder, field.v, field.told(ratio), slopes))
    with_it = build_model(replace(model.robot, remainder=remainder), model.task)
    return replace(calibration, model=with_it, bare=model, after=after, robot=calibrated_robot(with_it, after))


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
        raise RefusedError("what is measured does not move with the flange: leave out 'identification.remainder'")
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


def remainder_facts(
    calibration: Calibration, rng: np.random.Generator, area: tuple[Array, Array] | None = None
) -> dict[str, Any] | None:
    """What a remainder is and is worth, mm and rad; None where none was asked for.

    Args:
        area: lower and upper readings of the working area; the joint limits if None. rng: draws postures in it.
    """
    tried = calibration.trial
    if tried is None:
        return None
    candidate = tried.candidate
    out = {
        "kept": tried.kept,
        "said": said(tried),
        "folds": FOLDS,
        "poses": len(tried.given),
        "rms_without_mm": float(np.sqrt(np.mean(tried.without**2))),
        "rms_with_mm": float(np.sqrt(np.mean(tried.given**2))),
        "better_mm2": tried.better,
        "standard_error_mm2": tried.standard_error,
        "log_likelihood_gain": candidate.gain / 2,
        "lengths": dict(
            zip((j.name for j in calibration.model.robot.joints), candidate.kernel.lengths.tolist(), strict=True)
        ),
        "amplitude_mm": candidate.amplitude,
        "centres": len(candidate.centres),
    }
    if not tried.kept:
        return out
    robot = calibration.model.robot
    low, high = area or robot.ranges
    q = rng.uniform(low, high, (_POSTURES, robot.dof))
    return out | {"outside": outside(robot, q), "outside_of": "limits" if area is None else "area"}


def outside(robot: Robot, q: Array) -> float:
    """Share of postures (N, dof) at which the centres tell less than `TOLD` of the remainder's variance: there it is as
    good as zero; all of a robot without one."""
    return 1.0 if robot.remainder is None else float(np.mean(robot.remainder.told(q) < TOLD))
