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
import scipy
from numpy.typing import NDArray

from symcal.calibration.calibrate import Calibration
from symcal.calibration.extension import JointFinding, SharedFinding
from symcal.joints.gravity import OWN, Gravity
from symcal.kinematics import motions
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
    errors = after.x[calibration.model.parameters.indices(names)]
    values = errors + [described[name].nominal for name in names]
    covariance = after.posterior.covariance[np.ix_(own, own)]
    prior, size = after.posterior.assumed[own], np.array([described[name].scale for name in names])
    information = _information(covariance, prior)
    inverse = np.linalg.solve(covariance, errors)
    statistic = float(inverse @ np.linalg.pinv(information, hermitian=True, rcond=1e-9) @ inverse)
    p = float(scipy.special.chdtrc(len(names), statistic))
    if plausible is None:
        size = np.maximum(size, prior)  # as plausible as the data say
    else:
        information = _information(plausible[np.ix_(own, own)], size)
    strength = np.linalg.eigvalsh(information * np.outer(size, size))
    waves: dict[str, Any] = {}
    if [name.rpartition("_")[0].rpartition("_")[2] for name in names] == ["sin", "cos"]:
        weakest = float(np.max(size / np.sqrt(np.maximum(strength, 1e-30))))
        waves = _wave(values, covariance) | {
            "smallest": weakest * float(np.sqrt(scipy.special.chdtri(2, LEVEL / joints)))
        }
    return JointFinding(
        joint=joint,
        name=robot.joints[joint - 1].name,
        names=tuple(names),
        values=tuple(values.tolist()),
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


def _wave(values: Array, covariance: Array) -> dict[str, float | None]:
    """Amplitude and phase of s sin + c cos, to first order. Args: values: s and c."""
    sine, cosine = values.tolist()
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
    nominal = {p.name: p.nominal for p in robot.described}
    out = []
    for joint, weights in _as_waves(robot).items():
        names = [f"q{joint}_{wave}_1" for wave in ("sin", "cos")] + [f"q{joint}_gravity_{point}" for point in OWN]
        kept = [k for k, name in enumerate(names) if name in after.free]
        there = [names[k] for k in kept]
        if not there:
            continue
        coefficients = np.hstack([np.eye(2), weights])[:, kept]
        index = [after.free.index(name) for name in there]
        errors = after.x[calibration.model.parameters.indices(there)]
        total = coefficients @ (errors + [nominal[name] for name in there])
        found = _wave(total, coefficients @ after.posterior.covariance[np.ix_(index, index)] @ coefficients.T)
        out.append(
            SharedFinding(
                joint,
                robot.joints[joint - 1].name,
                found["amplitude"] or 0.0,
                found["amplitude_sigma"] or 0.0,
                found.get("phase") or 0.0,
                found.get("phase_sigma") or np.pi,
            )
        )
    return tuple(out)


def _as_waves(robot: Robot) -> dict[int, Array]:
    """The moments of a joint's own link as sine and cosine of its reading, beside a constant, shape (2, 2), of joints
    where they are these and nothing else at every pose."""
    weights = tuple(Gravity(i, True, points=tuple(OWN)) for i, j in enumerate(robot.joints, start=1) if j.revolute)
    q = np.random.default_rng(0).uniform(*robot.ranges, (_SAMPLES, robot.dof))
    out = {}
    for term, moments in zip(weights, motions(replace(robot, terms=weights), q), strict=True):
        turn = q[:, term.joint - 1]
        waves = np.column_stack([np.ones(_SAMPLES), np.sin(turn), np.cos(turn)])
        coefficients = np.linalg.lstsq(waves, moments, rcond=None)[0]
        left = np.sqrt(np.mean((moments - waves @ coefficients) ** 2, axis=0)).max()
        if left < _SAME and np.abs(coefficients[1:]).max() > _SOME:
            out[term.joint] = np.asarray(coefficients[1:])
    return out
