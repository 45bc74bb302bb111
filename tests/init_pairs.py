"""First files for every arm of the list with every instrument: `python tests/init_pairs.py [--plan EACH] [ARM ...]`.

Each pair is checked, and prepared for a plan, which is where plans are refused; every EACH-th is planned, with few
poses. A pair that `symcal init` refuses is one in which it says why. The tests have a short form.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from symcal.calibration.extend import planned_model
from symcal.drafts.files import write_first_files
from symcal.drafts.instrument import DRAFTS, Draft
from symcal.drafts.robot_file import RobotDraft, of_arm
from symcal.errors import SymcalError
from symcal.planning.drive_plan import plan_generator
from symcal.planning.plan_problem import plan_problem
from symcal.planning.sampling import feasible_shares
from symcal.robot.arms import arm_names
from symcal.runs.check import check_model
from symcal.runs.load import load
from symcal.runs.plan import run_plan

SMALL = ("plan.sample=300", "plan.random=0", "plan.method=exchange", "plan.promise.random=1")


@dataclass(frozen=True)
class Tried:
    """What became of a pair. refused: by init, in its words. seen: directions, of the free parameters.

    share: of the area, where measuring is possible. seconds: of the processor, for check and preparation.
    """

    refused: str = ""
    seen: int = 0
    free: int = 0
    share: float = 0.0
    seconds: float = 0.0


def tried(robot: RobotDraft, draft: Draft, folder: Path, *, plan: bool = False) -> Tried:
    """Write, check, prepare the plan, and plan where asked; errors of what was written are raised."""
    began = time.process_time()
    try:
        write_first_files(robot, draft, folder)
    except SymcalError as refusal:
        return Tried(refused=str(refusal))
    experiment = load(folder / "experiment.yaml")
    check_model(experiment.model)
    model = planned_model(experiment.model, experiment.file.identification.groups)
    problem = plan_problem(experiment.file, experiment.document, model, plan_generator(1))
    share, _ = feasible_shares(problem.area, problem.measuring)
    seconds = time.process_time() - began
    if plan:
        small = (*SMALL, f"plan.promise.counts=[{draft.poses}]")
        run_plan(folder / "experiment.yaml", folder / "plan", overrides=small)
    return Tried("", problem.info.rank, len(problem.info.names), share, seconds)


def pairs(arms: list[str]) -> Iterator[tuple[RobotDraft, Draft]]:
    for name in arms:
        robot = of_arm(name)
        for draft in DRAFTS.values():
            yield robot, draft


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--plan", type=int, default=0, metavar="EACH")
    parser.add_argument("arms", nargs="*")
    asked = parser.parse_args()
    wrong = 0
    for i, (robot, draft) in enumerate(pairs(asked.arms or list(arm_names()))):
        what = f"{robot.robot.name:24}{draft.name:13}"
        with tempfile.TemporaryDirectory() as folder:
            try:
                found = tried(robot, draft, Path(folder), plan=bool(asked.plan) and i % asked.plan == 0)
            except SymcalError as error:
                wrong += 1
                print(f"{what} WRONG: {error}", flush=True)
                continue
        said = f"refused: {found.refused}" if found.refused else f"{found.seen} of {found.free}, {found.share:.2f}"
        print(f"{what} {said}, {found.seconds:.1f} s", flush=True)
    print(f"{wrong} pairs do not work")
