"""Plans that are made in a moment, for tests of what is said about them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from symcal.runs.load import load
from symcal.runs.plan import PlanOutcome, plan_experiment

QUICK = (
    "plan.method=exchange",
    "plan.poses=10",
    "plan.sample=300",
    "plan.random=10",
    "plan.compare=[]",
    "plan.promise={counts: [10], random: 5}",
)
ABOVE_A_TABLE = (
    "plan.prove=false",
    "plan.constraints={planes: [{name: table, point: [0, 0, 600], normal: [0, 0, 1], first_link: 4}]}",
)
"""For the handling robot."""


@cache
def quick_plan(file: Path, *overrides: str) -> PlanOutcome:
    """Ten poses of a shipped experiment."""
    return plan_experiment(load(file, overrides=[*QUICK, *overrides]))
