"""All figures of a plan, in the order of its report."""

from __future__ import annotations

from symcal.planning.plan_study import PlanStudy
from symcal.plots.accuracy_forecast import error_by_poses
from symcal.plots.error_map import error_map
from symcal.plots.joint_motion import joint_motion
from symcal.plots.plan_space import plan_in_space
from symcal.plots.search_time import efficiency_over_search_time
from symcal.plots.spectrum import singular_values
from symcal.plots.style import Drawing, Illustration, drawing


def plan_drawings(found: PlanStudy) -> tuple[Drawing, ...]:
    """The figures that say what a plan is and what it is worth, still to be drawn."""
    promise, band = found.promise, found.band
    some = () if promise is None or band is None else (drawing(error_by_poses, found, promise, band),)
    return (
        drawing(plan_in_space, found),
        drawing(joint_motion, found),
        drawing(error_map, found),
        *some,
        drawing(efficiency_over_search_time, found),
        drawing(singular_values, found.problem.info.seen),
    )


def plan_figures(found: PlanStudy) -> tuple[Illustration, ...]:
    """Those of `plan_drawings`, drawn."""
    return tuple(illustration for each in plan_drawings(found) for illustration in each())
