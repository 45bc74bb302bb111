"""Plans proven for arms of four to seven joints that matter: how tight, in how many boxes and seconds.

    python tests/proof_bounds.py [cases]      names of cases; all when none is given

Seconds of the processor, of one core: for the plan with its search, and for the proofs of D and G alone. `loss` is how
much less the proven D-efficiency is than the searched one.
"""

# ruff: noqa: T201
from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent / "planning"))

from planning_cases import fr3, handling
from proof_cases import arm, informed

from symcal.planning.certificate import certify
from symcal.planning.criteria import criterion
from symcal.planning.information import PoseInformation
from symcal.planning.search import PROVEN_TOLERANCE, select_poses
from symcal.planning.worst_pose import feasible_set
from symcal.robot.files import load_robot

ROBOTS = Path(__file__).resolve().parents[1] / "configs" / "robots"

CASES: dict[str, Callable[[], PoseInformation]] = {
    "handling robot, position": handling,
    "5R, pose, base and tool unknown": lambda: informed(arm(5, 1), "pose", base=True, tool=True),
    "5R, position, base unknown": lambda: informed(arm(5, 1), "position", base=True),
    "6R, pose, base and tool unknown": lambda: informed(arm(6, 2), "pose", base=True, tool=True),
    "6R, position, base unknown": lambda: informed(arm(6, 2), "position", base=True),
    "UR5, pose, base and tool unknown": lambda: informed(load_robot(ROBOTS / "ur5.yaml"), "pose", base=True, tool=True),
    "UR5, position, base unknown": lambda: informed(load_robot(ROBOTS / "ur5.yaml"), "position", base=True),
    "WAM, position": lambda: informed(load_robot(ROBOTS / "wam.yaml"), "position"),
    "TIAGo, position": lambda: informed(load_robot(ROBOTS / "tiago.yaml"), "position"),
    "FR3, pose, base and tool unknown": fr3,
}


def main(wanted: list[str]) -> None:
    """A line per case."""
    print(f"{'':34}{'n':>4}{'joints':>8}{'D proven':>10}{'loss':>9}{'G proven':>10}{'open':>7}{'boxes':>7}", end="")
    print(f"{'rounding':>10}{'missed':>8}{'proof s':>9}{'plan s':>8}")
    for name in wanted or CASES:
        info = CASES[name]()
        began = time.process_time()
        plan = select_poses(info, 40, np.random.default_rng(1), random=0, prove=True)
        whole = time.process_time() - began
        proof, searched = plan.certificate.proof, plan.certificate.d_efficiency_lower_bound
        if proof is None:
            print(f"{name:34}not proven: {plan.certificate.unproven}")
            continue
        print(
            f"{name:34}{info.rank:4}{proof.joints:8}{proof.d_efficiency:10.5f}{searched - proof.d_efficiency:9.1e}"
            f"{proof.g_efficiency:10.5f}{proof.open_share:7.2%}{proof.boxes:7}{proof.rounding:10.1e}{proof.missed:8}"
            f"{proving(info, plan.poses, plan.certificate.design):9.2f}{whole:8.2f}",
            flush=True,
        )


def proving(info: PoseInformation, poses: np.ndarray, design: object) -> float:
    """Seconds that proofs add to a certificate whose design is known."""
    spent = []
    for prove in (False, True):
        rng = np.random.default_rng(2)
        where = feasible_set(info.area, rng, 1000)
        began = time.process_time()
        known = (design, design)
        certify(info, poses, criterion("D"), where, rng, designs=known, tolerance=PROVEN_TOLERANCE, prove=prove)
        spent.append(time.process_time() - began)
    return spent[1] - spent[0]


if __name__ == "__main__":
    main(sys.argv[1:])
