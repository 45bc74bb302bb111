"""What may be claimed: whether errors on poses that were not identified from support a calibration."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from symcal.identification.evaluate import Errors, statistics

Array = NDArray[np.float64]

_SIGNIFICANT = 2.0  # standard errors of the mean gain
_OPTIMISM = 1.5  # unseen over training rms; with many poses the ratio is near one


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
