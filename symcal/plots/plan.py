"""All figures of a plan, in the order of its report."""

from __future__ import annotations

from symcal.plan_experiment import PlanOutcome
from symcal.plots.error_map import error_map
from symcal.plots.joint_motion import joint_motion
from symcal.plots.plan_space import plan_in_space
from symcal.plots.promise import error_by_poses
from symcal.plots.search_time import efficiency_over_search_time
from symcal.plots.spectrum import singular_values
from symcal.plots.style import Illustration


def plan_figures(outcome: PlanOutcome) -> tuple[Illustration, ...]:
    """The figures that say what a plan is and what it is worth."""
    figures = [plan_in_space(outcome), joint_motion(outcome), error_map(outcome)]
    if outcome.promise is not None and outcome.band is not None:
        figures.append(error_by_poses(outcome, outcome.promise, outcome.band))
    return (*figures, efficiency_over_search_time(outcome), singular_values(outcome.problem.info.seen))
