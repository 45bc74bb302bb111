"""All figures of a plan, in the order of its report."""

from __future__ import annotations

from symcal.plan_experiment import PlanOutcome
from symcal.plots.style import Illustration


def plan_figures(outcome: PlanOutcome) -> tuple[Illustration, ...]:
    """The figures that say what a plan is."""
    return ()
