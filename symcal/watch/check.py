"""Does the calibration hold by today's readings, and if not, what changed?

There is alarm where a directed test (`symcal.watch.directed`) or the sum of squares is above its limit, alpha shared by
all of them. What changed is then told by fitting each hypothesis and asking what any other one would still add to it:
those to which none adds more than chance explain the readings by themselves, and are named together, the one with the
fewest numbers and the larger statistic first. A true single change is left out of its group once in a hundred times.
The readings of a pose that stand out from every explanation are left out, and named; also where a slip of theirs
explains all readings better than any change does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.errors import InputError, RefusedError
from symcal.robot.robot import Robot
from symcal.watch.directed import Law, Tested
from symcal.watch.explained import Explained, explain, outlying, placed_base
from symcal.watch.reference import BASE, REST, Hypothesis, Reference
from symcal.watch.sensitivity import Sensitivity, fewest, sensitivity

Array = NDArray[np.float64]

LEFT_OUT = 0.01
"""Share of true changes that are not in the group that is named."""
OUTLYING = 0.01
"""Share of good checks in which some reading is called gross."""
_LIMIT = 1e-6  # rad and mm: readings beyond a joint's limit that are rounding


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """A change that explains the readings by itself. values, half_widths: of its parameters, mm and rad; 95 %."""

    hypothesis: Hypothesis
    values: Array
    half_widths: Array


@dataclass(frozen=True, slots=True, eq=False)
class Check:
    """What a check says; made by `check`.

    labels: of the poses that count. sensitivity: of these poses. tests: of every hypothesis that is seen; rest: the sum
    of squares. unseen: hypotheses that these readings tell nothing of. alone: by joint, its offset if nothing else
    changed with the standard deviation, rad or mm. group: what explains the readings; empty where nothing changed, or
    no one change explains them. gross: the pose that was left out. residuals: by pose and state (`before`, `after` the
    first of the group), rms of the whitened readings.
    """

    labels: tuple[str, ...]
    moved: bool
    alpha: float
    sensitivity: Sensitivity
    tests: Mapping[str, Tested]
    rest: Tested
    unseen: tuple[str, ...]
    alone: Mapping[str, tuple[float, float]]
    group: tuple[Change, ...]
    gross: str | None
    residuals: Mapping[str, Array]

    @property
    def alarms(self) -> tuple[str, ...]:
        """Hypotheses whose tests are above their limits."""
        laws = self.sensitivity.laws
        return tuple(name for name, each in self.tests.items() if each.p <= laws[name].level)

    @property
    def holds(self) -> bool:
        return not self.alarms and self.rest.p > self.sensitivity.laws[REST].level

    @property
    def p(self) -> float:
        """Probability of a test as far beyond its share of alpha by chance, at most."""
        laws = self.sensitivity.laws
        every = {**self.tests, REST: self.rest}
        return float(min(1.0, *(each.p * self.alpha / laws[name].level for name, each in every.items())))


def check(reference: Reference, data: Dataset, *, alpha: float, offsets: Mapping[str, float], moved: bool) -> Check:
    """Judge a calibration by new readings.

    Args:
        alpha: probability of an alarm if nothing changed. offsets: of joints by name that are to be found, rad and mm:
            alpha is shared so that they are. moved: the instrument was set up anew since the calibration: the base is
            found from these readings.
    Raises:
        InputError: a pose beyond the joints' limits. RefusedError: the poses are too few, or see no joint.
    """
    _check_limits(reference.robot, data)
    needed = fewest(reference, moved=moved)
    _check_count(len(data), needed, moved)
    every, nothing, alarmed = _judged(reference, data, alpha, offsets, moved)
    law = every.sensitivity.laws[REST]
    number, p = outlying(alarmed, len(data), law)
    sure = p <= OUTLYING
    if not sure:  # a small slip may still explain the readings better than a change does
        number, p = outlying([nothing], len(data), law)
        if every.holds or p > every.p:
            return every
    label = data.labels[number]
    rest = data.take([i for i in range(len(data)) if i != number])
    without = _judged(reference, rest, alpha, offsets, moved)[0]
    if not (without.holds or (sure and without.group)):
        return every  # it is not the only one
    if len(rest) < needed:
        raise RefusedError(
            f"the reading of pose {label} fits none of what may have changed and looks like a slip, and the others are "
            f"too few to judge without it: measure it again, or {needed} poses besides it"
        )
    return replace(without, gross=label)


def _check_limits(robot: Robot, data: Dataset) -> None:
    for i, joint in enumerate(robot.joints):
        outside = (data.q[:, i] < joint.lower - _LIMIT) | (data.q[:, i] > joint.upper + _LIMIT)
        if outside.any():
            first = int(np.argmax(outside))
            factor, unit = (np.rad2deg(1.0), "deg") if joint.revolute else (1.0, "mm")
            raise InputError(
                f"pose '{data.labels[first]}' is beyond the limits of joint '{joint.name}': is the column in the unit "
                "of its name?",
                file=data.provenance or None,
                column=f"q{i + 1}",
                found=f"{data.q[first, i] * factor:.6g} {unit}",
                allowed=[f"{joint.lower * factor:.6g} to {joint.upper * factor:.6g} {unit}"],
            )


def _check_count(count: int, needed: int, moved: bool) -> None:
    if count < needed:
        unknown = ", with an instrument that was set up anew," if moved else ""
        raise RefusedError(
            f"{count} poses are too few{unknown} to tell one change from another and from a slip of a reading: "
            f"{needed} are needed at least"
        )


def _judged(
    reference: Reference, data: Dataset, alpha: float, offsets: Mapping[str, float], moved: bool
) -> tuple[Check, Explained, Sequence[Explained]]:
    """The check of all these poses, that nothing changed, and the explanations that its alarms leave."""
    base = placed_base(reference, data) if moved else None
    nothing = explain(reference, data, None, base)
    found = sensitivity(reference, nothing.linear, alpha, offsets, moved=moved)
    law, index = found.laws[REST], {h.name: reference.index(h) for h in found.seen}
    joints = [h for h in found.seen if h.joint is not None]
    if not joints:
        raise RefusedError("these poses tell of no joint: an offset of plausible size would not be found")
    tests = {h.name: nothing.adds(index[h.name], law) for h in found.seen}
    result = Check(
        labels=data.labels,
        moved=moved,
        alpha=alpha,
        sensitivity=found,
        tests=tests,
        rest=nothing.rest(law),
        unseen=tuple(h.name for h in reference.hypotheses if h.name not in index and not (moved and h.name == BASE)),
        alone={h.name: _alone(nothing, index[h.name]) for h in joints},
        group=(),
        gross=None,
        residuals={"before": _by_pose(nothing, len(data))},
    )
    if result.holds:
        return result, nothing, [nothing]
    fits = {h.name: explain(reference, data, h, base) for h in found.seen}
    level = LEFT_OUT / len(index)
    enough = [h for h in found.seen if _explains(fits[h.name], h, index, law, level)]
    enough.sort(key=lambda h: (len(h.parameters), -tests[h.name].squares))
    group = tuple(
        Change(h, fits[h.name].y[index[h.name]], law.half_width(np.sqrt(np.diag(fits[h.name].covariance))))
        for h in enough
    )
    residuals = dict(result.residuals)
    if enough:
        residuals["after"] = _by_pose(fits[enough[0].name], len(data))
    alarmed = [fits[name] for name in result.alarms] or [nothing]
    return replace(result, group=group, residuals=residuals), nothing, alarmed


def _explains(fit: Explained, own: Hypothesis, index: Mapping[str, NDArray[np.intp]], law: Law, level: float) -> bool:
    """Whether nothing adds more than chance to a hypothesis."""
    if fit.rest(law).p <= level:
        return False
    return all(fit.adds(other, law).p > level for name, other in index.items() if name != own.name)


def _alone(nothing: Explained, index: NDArray[np.intp]) -> tuple[float, float]:
    """Value and standard deviation of one number if it alone changed."""
    column = nothing.columns(index)
    left = (column - nothing.given @ (nothing.given.T @ column)).ravel()
    square = float(left @ left)
    return float(-(left @ nothing.white.r) / square), float(1 / np.sqrt(square))


def _by_pose(of: Explained, poses: int) -> Array:
    """Rms by pose of the readings over the noise, shape (N,)."""
    r, pose = of.linear.r / of.linear.spread, of.linear.pose
    squares, count = np.bincount(pose, r**2, minlength=poses), np.bincount(pose, minlength=poses)
    return np.asarray(np.sqrt(squares / np.maximum(count, 1)))
