"""What is said after every pose: how accurate the robot is for sure, how many more it takes, and which is next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from symcal.capture.aim import Aim
from symcal.capture.course import Course, Wanted
from symcal.capture.estimate import Estimate
from symcal.capture.promise import Accuracy, Forecast, Ground, first_ground, forecast, ground
from symcal.units import SHOWN
from symcal.words import number, plural

Order = Literal["best", "plan"]
"""The plan's pose that helps most, or the next one in its order; further ones of the region when these are used up."""
Ending = Literal["reached", "impossible", "used up", "moved", "mistaken"]


_REQUESTS = 5  # readings for each pose that is allowed, after which it is enough


@dataclass(frozen=True, slots=True)
class Outlook:
    """How a capture stands.

    poses: that were read and count. accuracy: over the region; None while it cannot be said. forecast: poses still
    needed; None without a tolerance. next: what to read; None where it ends, and then ending and why.
    """

    poses: int
    accuracy: Accuracy | None
    forecast: Forecast | None
    next: Wanted | None
    ending: Ending | None = None
    why: str = ""

    @property
    def said(self) -> str:
        """In one line."""
        if self.accuracy is None:
            return f"{plural(self.poses, 'pose')}: too few to say how accurate the robot is"
        text = f"{plural(self.poses, 'pose')}: {number(self.accuracy.sure)} mm rms over the region, 95 % sure"
        if self.forecast is None or self.forecast.poses == 0:
            return text
        if self.forecast.poses is None:
            return f"{text}; the tolerance is out of sight"
        return f"{text}; about {self.forecast.poses} more {'is' if self.forecast.poses == 1 else 'are'} needed"


def outlook(
    aim: Aim, course: Course, known: Estimate | None, order: Order = "best", most: int | None = None
) -> Outlook:
    """How a capture stands.

    Args:
        most: poses at most; the plan's, and as many again where a tolerance is wanted, when None.
    """
    taken = [aim.number(reading.pose) for reading in course.taken]
    poses = len(set(taken))
    there = first_ground(aim, taken) if known is None else ground(aim, known)
    left = [i for i in range(aim.planned) if aim.names[i] not in course.done]
    pool = [i for i in range(aim.planned, len(aim.names)) if aim.names[i] not in course.done]
    accuracy = None if known is None else there.accuracy
    if course.mistaken or (course.moved is not None and course.wanted is None):
        return Outlook(poses, accuracy, None, None, "mistaken" if course.mistaken else "moved", course.words)
    path = left if order == "plan" else []
    foretold = None if aim.tolerance is None or known is None else forecast(there, aim.tolerance, path, left or pool)
    if course.wanted is not None:
        return Outlook(poses, accuracy, foretold, course.wanted)
    ending, why = _ending(aim, known, accuracy, foretold, poses)
    limit = most if most is not None else aim.planned * (1 if aim.tolerance is None else 2)
    if not ending and (
        poses >= limit
        or course.last - course.begun >= _REQUESTS * limit
        or not (left or (pool and aim.tolerance is not None))
    ):
        ending = "used up"
        why = "every pose of the plan was read" if aim.tolerance is None else _used_up(foretold, poses)
    anchor = course.anchor
    if ending == "reached" and anchor is not None and course.unproved:  # it is not, if something has moved meanwhile
        last = Wanted(anchor.pose, "check", anchor.number, anchor.number + 1)
        return Outlook(poses, accuracy, foretold, last)
    if ending:
        return Outlook(poses, accuracy, foretold, None, ending, why)
    return Outlook(poses, accuracy, foretold, Wanted(aim.names[_next(there, left, pool, order)]))


def _next(there: Ground, left: list[int], pool: list[int], order: Order) -> int:
    if left and order == "plan":
        return left[0]
    return there.best(left or pool)


def _used_up(foretold: Forecast | None, poses: int) -> str:
    count = None if foretold is None else foretold.poses
    more = "" if count is None else f": about {count} more would be needed"
    return f"{plural(poses, 'pose')} were read, as many as were allowed, and the tolerance is not kept for sure{more}"


def _ending(
    aim: Aim, known: Estimate | None, accuracy: Accuracy | None, foretold: Forecast | None, poses: int
) -> tuple[Ending | None, str]:
    """Whether it is enough, or will never be: that is not said before robot and noise are known well."""
    if aim.tolerance is None or known is None or accuracy is None or foretold is None:
        return None, ""
    asked = f"{number(aim.tolerance)} mm"
    misfit = known.misfit
    sure = 2 * poses >= aim.planned
    if sure and misfit is not None and misfit.unit == "mm" and misfit.beyond > aim.tolerance:
        return "impossible", (
            f"{asked} cannot be kept: at the poses that were measured the model leaves {number(misfit.beyond)} mm rms "
            "and more beyond the noise that is stated, and more poses do not take that away. It is the model (play, "
            "elastic joints, waves of the gears: see 'identification.extend'), or the noise is not what is stated"
        )
    if accuracy.sure <= aim.tolerance:
        return "reached", (
            f"the rms error over the region is below {asked} with 95 % probability ({number(accuracy.sure)} mm)"
        )
    if foretold.poses is None and known.fit.dof >= len(aim.parameters) and sure:
        if foretold.floor >= aim.tolerance:
            return "impossible", (
                f"{asked} cannot be kept: {number(foretold.floor)} mm come from directions that no pose of this plan "
                "tells, however many are measured. Another target point, poses of a wider area, or a smaller region "
                "would help"
            )
        shown = ", ".join(_noise(aim, known))
        return "impossible", (
            f"{asked} cannot be kept: at this noise ({shown}) it would take more than a thousand poses. Measure more "
            "precisely, or ask for less"
        )
    return None, ""


def _noise(aim: Aim, known: Estimate) -> list[str]:
    groups = aim.model.measurement.groups
    return [f"{number(known.noise[g.name] * SHOWN[g.unit][1])} {SHOWN[g.unit][0]}" for g in groups]
