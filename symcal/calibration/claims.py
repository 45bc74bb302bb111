"""What may be claimed of an identification: gains that are no chance, poses like those that it was made from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from symcal.calibration.evaluate import Errors
from symcal.data.dataset import Dataset
from symcal.words import plural

Array = NDArray[np.float64]

_SIGNIFICANT = 2.0  # standard errors of the mean gain
_OPTIMISM = 1.5  # unseen over training rms; with many poses the ratio is near one
_NO_BETTER = 0.02  # relative gain that is none
_UNLIKE = 1e-3  # probability that poses of the same kind are called others
_FEW = 0.1  # of the poses: so many may be slips
_ENOUGH = 4  # poses that a slip can be told from
_APART = 4.0  # medians that a slip is off
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
    rms = {k: found.statistics.rms for k, found in (("b", before), ("a", after), ("t", trained))}
    gain = _per_pose(before) - _per_pose(after)
    error = float(gain.std(ddof=1) / np.sqrt(len(gain))) if len(gain) > 1 else np.inf
    found = []
    if gain.mean() <= _SIGNIFICANT * error:
        verdict = "no better" if rms["a"] >= rms["b"] else "better by no more than chance"
        found.append(
            f"{where} the calibrated robot ({rms['a']:.3g} {after.unit} rms) is {verdict} than the nominal one with "
            f"fitted frames ({rms['b']:.3g} {after.unit}): the data do not support an accuracy claim"
        )
    few = _few(after)
    if rms["a"] > _OPTIMISM * rms["t"] and few is not None:
        count, others = few
        found.append(
            f"{where} the error ({rms['a']:.3g} {after.unit} rms) is made by {plural(count, 'pose')} alone; the others "
            f"have {others:.3g} {after.unit}: look at what was measured there before anything else"
        )
    elif rms["a"] > _OPTIMISM * rms["t"]:
        found.append(
            f"{where} the error ({rms['a']:.3g} {after.unit} rms) is {rms['a'] / rms['t']:.2g} times that on the "
            f"training poses ({rms['t']:.3g} {after.unit}): more poses would help"
        )
    return tuple(found)


def _few(errors: Errors) -> tuple[int, float] | None:
    """How many poses, and the rms of the others, where few poses make most of the error; None where all do."""
    squares = np.sort(_per_pose(errors))
    for count in range(1, max(int(_FEW * len(squares)), 1) + 1):
        rest = squares[:-count]
        if (
            len(rest) >= _ENOUGH
            and squares[-count] > _APART**2 * np.median(rest)
            and np.mean(rest) < np.mean(squares) / 4
        ):
            return count, float(np.sqrt(np.mean(rest)))
    return None


def _per_pose(errors: Errors) -> Array:
    """Mean squared position error of every pose, mm^2."""
    poses, index = np.unique(errors.pose, return_inverse=True)
    return np.asarray(np.bincount(index, errors.size**2) / np.bincount(index, minlength=len(poses)))


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
    from scipy.stats import mannwhitneyu  # a second of start-up that few need

    if mannwhitneyu(others, own, alternative="greater").pvalue >= _UNLIKE:
        return ()
    return (
        f"the held-out poses combine the joints in other ways than the training poses (nearest training pose "
        f"{np.median(others):.2g} standard deviations away in the middle, against {np.median(own):.2g} among the "
        "training poses): there the calibration is an extrapolation",
    )


def worse(instruments: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    """Instruments that the identification explains no better than nominal kinematics does: some of several.

    Args:
        instruments: of results.json.
    """
    if len(instruments) < 2:
        return ()
    found = []
    for name, facts in instruments.items():
        part = next((part for part in ("test", "train") if "before" in facts["accuracy"].get(part, {})), None)
        if part is None:
            continue
        before, after = (facts["accuracy"][part][state]["rms"] for state in ("before", "after"))
        if after > (1 - _NO_BETTER) * before:
            found.append(
                f"what {name} reads is explained no better after the identification ({after:.3g} {facts['unit']} rms) "
                f"than before ({before:.3g}): look for slips in its readings, its unit, and where it stands"
            )
    return tuple(found)
