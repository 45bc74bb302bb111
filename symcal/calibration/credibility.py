"""What may be claimed: whether errors on poses that were not identified from support a calibration, and whether these
poses are like those that were."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial import cKDTree

from symcal.calibration.evaluate import Errors, statistics
from symcal.data.dataset import Dataset

Array = NDArray[np.float64]

_SIGNIFICANT = 2.0  # standard errors of the mean gain
_OPTIMISM = 1.5  # unseen over training rms; with many poses the ratio is near one
_UNLIKE = 1e-3  # probability that poses of the same kind are called others
_BEYOND = 0.1  # of the training range of a joint


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
