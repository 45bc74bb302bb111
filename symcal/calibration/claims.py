"""What may be claimed of an identification: gains that are no chance, poses like those that it was made from."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from symcal.calibration.evaluate import Errors
from symcal.data.dataset import Dataset
from symcal.fit.rank_tests import larger
from symcal.words import plural

Array = NDArray[np.float64]

_SIGNIFICANT = 2.0  # standard errors of the mean gain
_OPTIMISM = 1.5  # unseen over training rms; with many poses the ratio is near one
_NO_BETTER = 0.02  # relative gain that is none
_STILL = 1e-9  # rad, mm or shares: joints that vary by less stand still
_LEFT = 1e-6  # rad, mm or shares of a range
_UNLIKE = 1e-3  # probability that poses of the same kind are called others
_FEW = 0.1  # of the poses: so many may be slips
_PAIRS = 100_000  # of poses: so many distances are sooner taken than a tree of SciPy loaded
_ENOUGH = 4  # poses that a slip can be told from
_APART = 4.0  # medians that a slip is off
_BEYOND = 0.1  # of the training range of a joint
MOST_OUTSIDE = 0.2
"""Share of postures beyond the training poses from which on a robot is used where it was not measured. Of postures like
the N training poses one in N + 1 lies beyond all of them."""


@dataclass(frozen=True, slots=True)
class Gain:
    """How much better a calibrated robot is than the nominal one with fitted frames, at poses it was not made from.

    Judged pose by pose: the mean of the paired difference of squared errors, before minus after, against its standard
    error. This is the one place of it.

    part: what judged. before, after: rms, in ``unit`` (mm or deg). mean, error: of the paired difference, unit squared.
    """

    part: str
    before: float
    after: float
    unit: str
    mean: float
    error: float

    @staticmethod
    def of(errors: Mapping[str, Mapping[str, Errors]], aside: Collection[int] = ()) -> Gain | None:
        """By the test split, else by cross-validation, else by poses left out in turn; None where there is none of it.

        Args:
            errors: by data (`train`, `test`, `cross_validation`, `left_out`) and state (`before`, `after`). aside:
                numbers of test poses that are gross slips: they would hide any gain.
        """
        name = judging_part(errors)
        if name is None or "before" not in errors[name]:
            return None
        before, after = (
            _without(errors[name][state], aside if name == "test" else ()) for state in ("before", "after")
        )
        if not after.pose.size:
            return None
        gain = _per_pose(before) - _per_pose(after)
        error = float(gain.std(ddof=1) / np.sqrt(len(gain))) if len(gain) > 1 else np.inf
        return Gain(name, before.statistics.rms, after.statistics.rms, after.unit, float(gain.mean()), error)

    @property
    def beyond_chance(self) -> bool:
        """Whether the gain is more than two of its standard errors."""
        return self.mean > _SIGNIFICANT * self.error

    @property
    def text(self) -> str:
        """In a sentence without a full stop."""
        where = where_judged(self.part)
        if self.beyond_chance:
            by = f" by {self.mean / self.error:.3g} standard errors" if self.error > 0 else ""
            return (
                f"{where} it is better than the nominal robot with fitted frames{by} ({self.after:.3g} {self.unit} rms "
                f"instead of {self.before:.3g} {self.unit})"
            )
        verdict = "no better" if self.after >= self.before else "better by no more than chance"
        return (
            f"{where} the calibrated robot ({self.after:.3g} {self.unit} rms) is {verdict} than the nominal one with "
            f"fitted frames ({self.before:.3g} {self.unit}): the data do not support an accuracy claim"
        )


def judging_part(errors: Mapping[str, Mapping[str, Errors]]) -> str | None:
    """The part of the data that judges; None where nothing was left out of the identification."""
    return next((part for part in ("test", "cross_validation", "left_out") if "after" in errors.get(part, {})), None)


def where_judged(part: str) -> str:
    """`on the test poses`."""
    return {
        "test": "on the test poses",
        "cross_validation": "in cross-validation",
        "left_out": "on poses left out in turn",
    }[part]


def optimism(errors: Mapping[str, Mapping[str, Errors]]) -> tuple[str, ...]:
    """That errors on training poses are much smaller than on those that judge.

    Args:
        errors: by data and state.
    """
    name = "test" if "test" in errors else "cross_validation"
    if name not in errors:
        return ()
    after, trained = errors[name]["after"], errors["train"]["after"]
    judged, own = after.statistics.rms, trained.statistics.rms
    if judged <= _OPTIMISM * own:
        return ()
    few = _few(after)
    if few is not None:
        count, others = few
        return (
            f"{where_judged(name)} the error ({judged:.3g} {after.unit} rms) is made by {plural(count, 'pose')} alone; "
            f"the others have {others:.3g} {after.unit}: look at what was measured there before anything else",
        )
    return (
        f"{where_judged(name)} the error ({judged:.3g} {after.unit} rms) is {judged / own:.2g} times that on the "
        f"training poses ({own:.3g} {after.unit}): more poses would help",
    )


def _without(errors: Errors, poses: Collection[int]) -> Errors:
    """The errors at other poses."""
    if not poses:
        return errors
    kept = ~np.isin(errors.pose, list(poses))
    turns = errors.rotations
    return replace(
        errors,
        vectors=errors.vectors[kept],
        pose=errors.pose[kept],
        point=errors.point[kept],
        rotations=None if turns is None else turns[kept],
    )


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
    own, others = nearest(train @ axes, test @ axes)
    if larger(others, own) >= _UNLIKE:
        return ()
    return (
        f"the held-out poses combine the joints in other ways than the training poses (nearest training pose "
        f"{np.median(others):.2g} standard deviations away in the middle, against {np.median(own):.2g} among the "
        "training poses): there the calibration is an extrapolation",
    )


def nearest(points: Array, others: Array) -> tuple[Array, Array]:
    """Distances of points to the nearest other one of them, shape (N,), and of others to the nearest point, (M,)."""
    if len(points) * (len(points) + len(others)) > _PAIRS:
        tree = scipy.spatial.cKDTree(points)
        return np.asarray(tree.query(points, k=2)[0])[:, 1], np.asarray(tree.query(others)[0])
    own, beside = (np.linalg.norm(each[:, None] - points, axis=2) for each in (points, others))
    np.fill_diagonal(own, np.inf)
    return np.asarray(own.min(axis=1)), np.asarray(beside.min(axis=1))


@dataclass(frozen=True, slots=True)
class Outside:
    """share: of postures, ``of`` (`the working area`), that lie beyond the training poses."""

    share: float
    of: str


def outside(train: Array, postures: Array, of: str) -> Outside | None:
    """How many postures lie beyond the training poses; None where these are too few to tell.

    A posture does whose leverage on the training poses, h = 1 / n + (q - m)^T S^-1 (q - m), is larger than that of any
    training pose on the others ([Cook1982] sec. 2.2): that also shows new combinations of joints within the old ranges,
    and a box whose corners were measured holds its inside. So does one that leaves what the training poses spanned.

    Args:
        train, postures: joint readings, shapes (N, dof) and (M, dof), rad and mm.
    """
    count, dof = train.shape
    if count <= dof + 2 or len(postures) == 0:
        return None
    span, middle = np.ptp(train, axis=0), train.mean(axis=0)
    span = np.where(span > _STILL, span, 1.0)
    _, s, vt = np.linalg.svd((train - middle) / span, full_matrices=False)
    moved = s > _STILL * max(s[0], 1.0)
    axes = vt[moved].T / s[moved]
    own, asked = (1 / count + np.sum(((q - middle) / span @ axes) ** 2, axis=1) for q in (train, postures))
    most = float((own / np.maximum(1 - own, 1e-12)).max())
    across = (postures - middle) / span
    across = np.linalg.norm(across - across @ vt[moved].T @ vt[moved], axis=1)
    return Outside(float(np.mean((across > _LEFT) | (asked > most))), of)


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
