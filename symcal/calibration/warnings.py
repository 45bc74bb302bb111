"""What a person should know before believing an identification, and what may be claimed of it: wrong units, outliers,
too few poses, poses that are not like those that were identified from.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial import cKDTree

from symcal.calibration.evaluate import Errors, statistics
from symcal.data.dataset import Dataset
from symcal.errors import RefusedError
from symcal.fit.estimation import Fit
from symcal.fit.noise import known_sigma, spread_of
from symcal.fit.residual_rows import rows_of
from symcal.model.model import Model, State
from symcal.placing.registration import LEVER

Array = NDArray[np.float64]

_STANDS_OUT = 4.0  # medians: a residual larger than this is one slip that spoils the others
_OUTLIER = 1e-6  # probability that one good observation is called an outlier
_ABSURD = 20.0  # scales: a correction larger than this is a mistake more often than a fact
_WRONG_NOISE = 1.5  # residuals over stated noise
_LARGER = 3.0  # factor on the plausible sizes that a reader is told
_NONSENSE = 0.1  # of the robot's length
_NONSENSE_TURN = np.deg2rad(20.0)
_SIGNIFICANT = 2.0  # standard errors of the mean gain
_OPTIMISM = 1.5  # unseen over training rms; with many poses the ratio is near one
_UNLIKE = 1e-3  # probability that poses of the same kind are called others
_BEYOND = 0.1  # of the training range of a joint


def plausibility(data: Dataset, before: State) -> tuple[str, ...]:
    """What the nominal robot with fitted frames says about units, joint order and signs."""
    model = before.model
    r, _ = rows_of(model.measurement, data, before.setup, model.residual)(before.x)
    position, measured, seen = _positions(model, data, r)
    error, spread, reach = (
        float(np.sqrt(np.mean(np.sum(values[seen] ** 2, axis=1))))
        for values in (position, _about_centre(measured, seen), _about_centre(measured + position, seen))
    )
    small = reach > 1.0 and 0 < spread < reach / 30
    large = spread > 30 * max(reach, 1.0) or spread > 30 * max(_size(model, data), LEVER)  # a tool of any length fits
    unit = model.measurement.groups[0].unit
    if unit == "mm" and (small or large):
        raise RefusedError(
            f"the measured points spread over {spread:.3g} mm, the robot's over "
            f"{min(reach, _size(model, data)):.3g} mm: the measurements are not in the unit that their columns name"
        )
    extent = max(reach, 1.0 if model.task.instrument.reads_points else LEVER)
    if error > 0.1 * extent:
        return (
            f"nominal kinematics with fitted frames is off by {error:.4g} {unit} rms, {error / extent:.0%} of the "
            "measured spread: check the order, units and signs of the joint columns, and the robot file",
        )
    return ()


def _positions(model: Model, data: Dataset, r: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Residuals and measurements of points, shape (k, 3) each, mm (in images (k, 2), px), and which were seen."""
    group = model.measurement.groups[0]
    position = r[:, list(group.columns)].reshape(-1, group.block)
    measured = data.z[:, : len(group.columns)].reshape(-1, group.block)
    return position, measured, np.asarray(np.isfinite(measured).all(axis=1))


def _about_centre(points: Array, seen: NDArray[np.bool_]) -> Array:
    return np.asarray(points - points[seen].mean(axis=0))


def quality(model: Model, data: Dataset, after: Fit) -> tuple[str, ...]:
    """What the identification says about itself.

    Raises:
        RefusedError: the identified model does not explain the measurements at all.
    """
    _refuse_nonsense(model, data, after)
    notes = []
    learnt = after.equations - after.dof
    if after.dof < 2 * learnt:
        notes.append(
            f"only {after.dof:.0f} degrees of freedom are left for {learnt:.0f} parameters' worth that was learnt "
            f"({len(data)} poses): the errors on the training data say little about other poses; trust the held-out or "
            "cross-validated ones"
        )
    if not after.converged:
        notes.append(f"the identification did not converge: {after.trouble}")
    notes += _outliers(model, data, after)
    if after.factor > _LARGER:
        notes.append(
            f"the errors of this robot are about {after.factor:.2g} times as large as their plausible sizes: the robot "
            "file is further off than stated, or the model lacks something and the parameters make up for it"
        )
    errors = model.parameters.mapping(after.x)
    large = [
        name
        for name in model.kinematic
        if abs(errors[name]) > _ABSURD * model.parameters.items[model.parameters.index(name)].scale
    ]
    if large:
        notes.append(
            f"corrections of {', '.join(large)} are more than {_ABSURD:.0f} times their plausible scale: check signs, "
            "units and zero positions, or give larger 'scales'"
        )
    for name, (squares, dof) in after.by_group.items():
        factor = float(np.sqrt(squares / dof)) if dof > 1 and name not in after.estimated else 1.0
        if factor > _WRONG_NOISE or factor < 1 / _WRONG_NOISE:
            notes.append(
                f"{name} residuals are {factor:.3g} times the stated noise: the noise is stated too "
                + ("small, or the model lacks something" if factor > 1 else "large")
            )
    return tuple(notes)


def _refuse_nonsense(model: Model, data: Dataset, after: Fit) -> None:
    """Wrong units, signs and joint order leave errors of the robot's own size; medians, so that a slip is no reason."""
    r, _ = rows_of(model.measurement, data, after.setup, model.residual)(after.x)
    position, measured, seen = _positions(model, data, r)
    error = float(np.median(np.linalg.norm(position[seen], axis=1)))
    spread = float(np.median(np.linalg.norm(_about_centre(measured, seen)[seen], axis=1)))
    wrong, unit = [], model.measurement.groups[0].unit
    if error > spread / 4 and (unit != "mm" or error > _NONSENSE * _size(model, data)):
        wrong.append(f"{error:.4g} {unit} (the measured points spread over {spread:.4g} {unit})")
    if not model.task.instrument.reads_points:
        turn = float(np.median(np.linalg.norm(r[:, list(model.measurement.groups[1].columns)], axis=1)))
        if turn > _NONSENSE_TURN:
            wrong.append(f"{np.rad2deg(turn):.3g} deg")
    if not wrong:
        return
    pose = ", the order x, y, z, w of the quaternion, 'invert'" if not model.task.instrument.reads_points else ""
    raise RefusedError(
        f"even after the identification half of the poses are off by more than {' and '.join(wrong)}: these are not "
        f"measurements of this robot as it is described; check units, signs and order of the joint columns, the unit "
        f"of the measurement{pose}, and the robot file" + "".join(f"; {note}" for note in data.notes[:3])
    )


def _size(model: Model, data: Dataset) -> float:
    """The nominal robot's length: links, strokes in these data, tool; mm."""
    lengths = [abs(v) for link in model.robot.links for kind, v in link.parameters.items() if kind in ("a", "d")]
    strokes = [np.ptp(data.q[:, i]) for i, joint in enumerate(model.robot.joints) if not joint.revolute]
    return float(sum(lengths) + sum(strokes) + np.linalg.norm(model.robot.tool[:3, 3]))


def _outliers(model: Model, data: Dataset, after: Fit) -> list[str]:
    """Observations whose residual is no accident at the noise of the others."""
    rows = rows_of(model.measurement, data, after.setup, model.residual)
    r, _ = rows(after.x)
    spread = spread_of(rows, known_sigma(rows, {}), after.sigmas, np.ones_like(r))
    advice = "measure them again"
    if (after.weights == rows.seen).all():
        advice += " or use 'loss: huber'"
    found = []
    for group in model.measurement.groups:
        white = (r / spread)[:, list(group.columns)].reshape(len(data), -1, group.block)
        norms = np.linalg.norm(white, axis=2).max(axis=1)
        limit = np.sqrt(stats.chi2.isf(_OUTLIER, group.block))
        worst = [data.labels[i] for i in np.argsort(-norms) if norms[i] > limit]
        if len(worst) > len(data) / 5 and norms.max() < _STANDS_OUT * np.median(norms):
            found.append(
                f"{len(worst)} of {len(data)} training poses have a {group.name} residual beyond the noise: not "
                "outliers, but a noise stated too small or an effect that the model lacks"
            )
        elif worst:
            listed = ", ".join(worst[:5]) + (", ..." if len(worst) > 5 else "")
            found.append(
                f"{len(worst)} training pose(s) have a {group.name} residual that the noise of the others does not "
                f"explain (pose {listed}): {advice}"
            )
    return found


def claim(errors: Mapping[str, Mapping[str, Errors]]) -> tuple[str, ...]:
    """Reasons why no accuracy should be claimed; empty when the data support one.

    The test split decides, else the cross-validation. The gain is judged pose by pose: the mean of the paired
    difference of squared errors, before minus after, against its standard error.

    Args:
        errors: by data (`train`, `test`, `cross_validation`) and state (`before`, `after`).
    """
    name = "test" if "test" in errors else "cross_validation"
    if name not in errors:
        return ("nothing was held out and nothing cross-validated: the data do not support an accuracy claim",)
    where = "on the test poses" if name == "test" else "in cross-validation"
    before, after, trained = errors[name]["before"], errors[name]["after"], errors["train"]["after"]
    rms = {k: statistics(found.position).rms for k, found in (("b", before), ("a", after), ("t", trained))}
    gain = _per_pose(before) - _per_pose(after)
    error = float(gain.std(ddof=1) / np.sqrt(len(gain))) if len(gain) > 1 else np.inf
    found = []
    if gain.mean() <= _SIGNIFICANT * error:
        verdict = "no better" if rms["a"] >= rms["b"] else "better by no more than chance"
        found.append(
            f"{where} the calibrated robot ({rms['a']:.3g} mm rms) is {verdict} than the nominal one with fitted "
            f"frames ({rms['b']:.3g} mm): the data do not support an accuracy claim"
        )
    if rms["a"] > _OPTIMISM * rms["t"]:
        found.append(
            f"{where} the error ({rms['a']:.3g} mm rms) is {rms['a'] / rms['t']:.2g} times that on the training poses "
            f"({rms['t']:.3g} mm): more poses would help"
        )
    return tuple(found)


def _per_pose(errors: Errors) -> Array:
    """Mean squared position error of every pose, mm^2."""
    poses, index = np.unique(errors.pose, return_inverse=True)
    return np.asarray(np.bincount(index, errors.position**2) / np.bincount(index, minlength=len(poses)))


def extrapolation(data: Dataset) -> tuple[str, ...]:
    """Where the held-out poses are not like the training poses: what was identified there need not hold for them.

    Distances to the nearest training pose, in joint coordinates that are decorrelated by the training poses' own
    covariance, are compared with those of the training poses among themselves by a rank test ([Mann1947]): that also
    shows new combinations of joints within the old ranges. Ours.
    """
    train, test = data.part("train").q, data.part("test").q
    if len(test) == 0 or len(train) <= train.shape[1] + 1:
        return ()
    low, high = train.min(axis=0), train.max(axis=0)
    slack = _BEYOND * (high - low)
    beyond = int(((test < low - slack) | (test > high + slack)).any(axis=1).sum())
    if beyond:
        return (
            f"{beyond} of {len(test)} held-out poses have joints beyond the range of the training poses: there the "
            "calibration is an extrapolation",
        )
    _, s, vt = np.linalg.svd(train - train.mean(axis=0), full_matrices=False)
    moved = s > 1e-9 * s[0]
    axes = vt[moved].T / s[moved] * np.sqrt(len(train) - 1)
    tree = cKDTree(train @ axes)
    own: Array = np.asarray(tree.query(train @ axes, k=2)[0], dtype=np.float64)[:, 1]
    others: Array = np.asarray(tree.query(test @ axes)[0], dtype=np.float64)
    if stats.mannwhitneyu(others, own, alternative="greater").pvalue >= _UNLIKE:
        return ()
    return (
        f"the held-out poses combine the joints in other ways than the training poses (nearest training pose "
        f"{np.median(others):.2g} standard deviations away in the middle, against {np.median(own):.2g} among the "
        "training poses): there the calibration is an extrapolation",
    )
