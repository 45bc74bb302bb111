"""All figures of a plan, in the order of its report."""

from __future__ import annotations

from symcal.planning.plan_study import PlanStudy
from symcal.plots.accuracy_forecast import error_by_poses
from symcal.plots.error_map import error_map
from symcal.plots.joint_motion import joint_motion
from symcal.plots.plan_space import plan_in_space
from symcal.plots.search_time import efficiency_over_search_time
from symcal.plots.spectrum import singular_values
from symcal.plots.style import Illustration


def plan_figures(found: PlanStudy) -> tuple[Illustration, ...]:
    """The figures that say what a plan is and what it is worth."""
    figures = [plan_in_space(found), joint_motion(found), error_map(found)]
    if found.promise is not None and found.band is not None:
        figures.append(error_by_poses(found, found.promise, found.band))
    return (*figures, efficiency_over_search_time(found), singular_values(found.problem.info.seen))
