r"""What a group of joint terms is at each joint: amplitude, phase, whether the data name the joint or do not see it.

With the posterior mean m and covariance C of a joint's numbers in the group, and their prior variance T (diagonal), the
data alone say b = P^-1 C^-1 m with information P = C^-1 - T^-1; the joint is named when b^T P b, chi-squared with as
many degrees of freedom as numbers if it has no such term, is beyond its 1e-3 point divided by the number of joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from symcal import kinematics
from symcal.calibration.calibrate import Calibration
from symcal.calibration.extension import JointFinding, SharedFinding
from symcal.joints.gravity import OWN, Gravity
from symcal.kernels import batch_function
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

LEVEL = 1e-3
"""Probability that any joint of a group is named without cause."""
_SEEN = 1.0  # information over that of the plausible size: as everywhere
_SAMPLES = 200
_SAME = 1e-9
_SOME = 1e-3


def joint_findings(calibration: Calibration, group: str, plausible: Array | None = None) -> tuple[JointFinding, ...]:
    """What a group is at each joint that has some of it, from the fit of all parameters.

    Args:
        plausible: covariance of the free parameters, were the group as large as is plausible, of one that was left out;
            its own has shrunk to nothing and hides what the data could tell.
    """
    robot, after = calibration.model.robot, calibration.after
    place = {name: i for i, name in enumerate(after.free)}
    by_joint: dict[int, list[str]] = {}
    for term in robot.terms:
        for p in term.parameters:
            if p.group == group and p.name in place:
                by_joint.setdefault(term.joint, []).append(p.name)
    return tuple(
        _finding(calibration, joint, names, place, len(by_joint), plausible) for joint, names in by_joint.items()
    )


def _finding(
    calibration: Calibration,
    joint: int,
    names: Sequence[str],
    place: dict[str, int],
    joints: int,
    plausible: Array | None,
) -> JointFinding:
    robot, after = calibration.model.robot, calibration.after
    own = [place[name] for name in names]
    described = {p.name: p for p in robot.described}
    values = np.array([described[n].nominal for n in names])
    errors = after.x[calibration.model.parameters.indices(list(names))]
    covariance = after.posterior.covariance[np.ix_(own, own)]
    prior = after.posterior.assumed[own]
    information = _information(covariance, prior)
    inverse = np.linalg.solve(covariance, errors)
    statistic = float(inverse @ np.linalg.pinv(information, hermitian=True, rcond=1e-9) @ inverse)
    rank = len(names)
    p = float(chi2.sf(statistic, rank))
    size = np.array([described[n].scale for n in names])
    if plausible is None:
        size = np.maximum(size, prior)  # as plausible as the data say
    else:
        information = _information(plausible[np.ix_(own, own)], size)
    strength = np.linalg.eigvalsh(information * np.outer(size, size))
    waves: dict[str, Any] = {}
    sines = [i for i, n in enumerate(names) if "_sin_" in n or n.endswith("_sin")]
    if len(names) == 2 and sines:
        waves = _wave(float(values[0] + errors[0]), float(values[1] + errors[1]), covariance)
        weakest = float(np.max(size / np.sqrt(np.maximum(strength, 1e-30))))
        waves["smallest"] = weakest * float(np.sqrt(chi2.isf(LEVEL / joints, 2)))
    return JointFinding(
        joint=joint,
        name=robot.joints[joint - 1].name,
        names=tuple(names),
        values=tuple((values + errors).tolist()),
        sigmas=tuple(np.sqrt(np.diag(covariance)).tolist()),
        p=p,
        named=p < LEVEL / joints,
        seen=int(np.sum(strength > _SEEN)),
        unit=described[names[0]].unit,
        **waves,
    )


def _information(covariance: Array, prior: Array) -> Array:
    """C^-1 - T^-1 without negative directions, shape (k, k)."""
    scale = np.outer(prior, prior)
    values, axes = np.linalg.eigh(covariance / scale)
    gained = np.maximum(1 / np.clip(values, 1e-300, None) - 1, 0.0)
    return np.asarray((axes * gained) @ axes.T / scale)


def _wave(sine: float, cosine: float, covariance: Array) -> dict[str, float | None]:
    """Amplitude and phase of s sin + c cos, to first order."""
    amplitude = float(np.hypot(sine, cosine))
    if amplitude == 0:
        return {"amplitude": 0.0, "amplitude_sigma": float(np.sqrt(np.max(np.diag(covariance))))}
    along = np.array([sine, cosine]) / amplitude
    across = np.array([-cosine, sine]) / amplitude**2
    return {
        "amplitude": amplitude,
        "amplitude_sigma": float(np.sqrt(along @ covariance @ along)),
        "phase": float(np.arctan2(cosine, sine)),
        "phase_sigma": float(np.sqrt(across @ covariance @ across)),
    }


def shared_findings(calibration: Calibration) -> tuple[SharedFinding, ...]:
    """First harmonics and gravity moments of the own link that are one and the same, where one of them is estimated."""
    robot, after = calibration.model.robot, calibration.after
    out = []
    for joint in _turns_alike(robot):
        waves = [f"q{joint}_{wave}_1" for wave in ("sin", "cos")]
        weights = [f"q{joint}_gravity_{point}" for point in OWN]
        there = [name for name in (*waves, *weights) if name in after.free]
        if not there:
            continue
        coefficients = np.hstack([np.eye(2), _as_waves(robot, joint)[0][1:]])
        coefficients = coefficients[:, [(*waves, *weights).index(name) for name in there]]
        index = [list(after.free).index(name) for name in there]
        described = {p.name: p.nominal for p in robot.described}
        values = np.array([described[name] for name in there])
        total = coefficients @ (values + after.x[calibration.model.parameters.indices(there)])
        covariance = coefficients @ after.posterior.covariance[np.ix_(index, index)] @ coefficients.T
        found = {key: value or 0.0 for key, value in _wave(float(total[0]), float(total[1]), covariance).items()}
        out.append(
            SharedFinding(
                joint,
                robot.joints[joint - 1].name,
                found["amplitude"],
                found["amplitude_sigma"],
                found.get("phase", 0.0),
                found.get("phase_sigma", np.pi),
            )
        )
    return tuple(out)


def _turns_alike(robot: Robot) -> tuple[int, ...]:
    """Joints at which a first harmonic and the gravity moment of the own link are one and the same at every pose."""
    turning = [i for i, joint in enumerate(robot.joints, start=1) if joint.revolute]
    found = [(i, *_as_waves(robot, i)) for i in turning]
    return tuple(i for i, waves, left in found if left < _SAME and np.abs(waves[1:]).max() > _SOME)


def _as_waves(robot: Robot, joint: int) -> tuple[Array, float]:
    """The moments of the own link as a constant, sine and cosine of the reading, shape (3, 2), and what is left."""
    own = replace(robot, terms=(Gravity(joint, True, points=tuple(OWN)),))
    q = np.random.default_rng(0).uniform(*robot.ranges, (_SAMPLES, robot.dof))
    (columns,) = batch_function(kinematics.bases(own), evaluations=0)(q)
    turn = q[:, joint - 1]
    return _explained(np.column_stack([np.ones(_SAMPLES), np.sin(turn), np.cos(turn)]), columns)


def _explained(waves: Array, columns: Array) -> tuple[Array, float]:
    """Columns as sums of a constant, sine and cosine of the joint, shape (3, k), and the largest rms that is left."""
    coefficients, *_ = np.linalg.lstsq(waves, columns, rcond=None)
    left = columns - waves @ coefficients
    return np.asarray(coefficients), float(np.sqrt(np.mean(left**2, axis=0)).max())
