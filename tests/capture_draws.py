"""Captures against simulated instruments, many of them: what was promised against the truth; long form of
test_capture.py.

    python tests/capture_draws.py [runs] [best|plan] [stated|estimated] [--bump MM] [--slips SHARE]

A UR5e and a tracker as `symcal init` writes them, base and reflector unknown, 0.1 mm wanted at 0.05 mm noise. The
witness has forward kinematics of its own: the rms distance over the region of where calibrated and true robot put the
reflector, as identified, and with base and reflector fitted to the truth.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest

from symcal.calibration.calibrate import calibrated_robot, one_thread
from symcal.calibration.compensation_check import true_robot
from symcal.capture.aim import Aim, aim_of
from symcal.capture.course import Course
from symcal.capture.estimate import Estimate
from symcal.capture.judging import judge
from symcal.capture.outlook import Order, Outlook, outlook
from symcal.capture.simulated import Mishaps, Simulated, simulated
from symcal.drafts.files import write_first_files
from symcal.drafts.instrument import draft_named
from symcal.drafts.robot_file import of_arm
from symcal.planning.area import draw
from symcal.planning.plan_file import write_plan
from symcal.planning.plan_problem import plan_problem
from symcal.robot.robot import Robot
from symcal.runs.load import load
from symcal.runs.plan import run_plan

Array = NDArray[np.float64]
TOLERANCE, NOISE = 0.1, 0.05


@dataclass(frozen=True)
class Run:
    """One capture: how it ended, and what is true of it, mm. seen: number of the reading at which a move was told."""

    course: Course
    outlook: Outlook
    known: Estimate | None
    error: float
    fitted: float

    @property
    def requests(self) -> int:
        return self.course.last


def lead(aim: Aim, there: Simulated, order: Order) -> tuple[Course, Outlook, Estimate | None]:
    """A capture without its files."""
    course, known = Course(), None
    while True:
        now = outlook(aim, course, known, order)
        if now.next is None:
            return course, now, known
        number, pose = course.last + 1, aim.number(now.next.pose)
        q, came = aim.poses[pose], aim.directions(number)
        z = there.read(number, q, came)
        if z is None:
            course = course.after({"event": "missed", "number": number, "pose": now.next.pose, "why": ""})
            continue
        of = asdict(now.next)
        read = {"event": "reading", "number": number, "q": q, "z": z, "from": came}
        course = course.after(read | of)
        done = judge(aim, course, known, course.readings[-1])
        course, known = done.course, done.known


# ------------------------------------------------------------------------------------------ the witness: kinematics


def reflector(robot: Robot, q: Array, point: Array) -> Array:
    """Where a robot puts a point of its tool, shape (N, 3)."""
    return (tool_frames(robot, q) @ np.append(point, 1.0))[:, :3]


def tool_frames(robot: Robot, q: Array) -> Array:
    """Where a robot of the standard convention puts its tool, shape (N, 4, 4); each link is Rz Tz Tx Rx Ry."""
    at = np.broadcast_to(robot.base, (len(q), 4, 4))
    for i, link in enumerate(robot.links):
        p = {name: link.parameters.get(name, 0.0) for name in ("theta", "d", "a", "alpha", "beta")}
        turn = Rotation.from_euler("z", (q[:, i] + p["theta"])[:, None]).as_matrix()
        step = np.tile(np.eye(4), (len(q), 1, 1))
        step[:, :3, :3] = turn @ Rotation.from_euler("XY", [p["alpha"], p["beta"]]).as_matrix()
        step[:, :3, 3] = turn @ np.array([p["a"], 0.0, 0.0]) + [0.0, 0.0, p["d"]]
        at = at @ step
    return np.asarray(at @ robot.tool)


def errors(aim: Aim, there: Simulated, known: Estimate) -> tuple[float, float]:
    """Rms distance over the region as identified, and with base and reflector fitted, mm."""
    model, q = aim.model, aim.problem.region.poses[:500]
    true = reflector(true_robot(model, there.truth), q, _point(model.setup.points[0], there.truth))
    found = calibrated_robot(model, known.fit)
    point = model.moved(known.setup, known.fit.x).points[0]
    off = reflector(found, q, point) - true

    def fitted(y: Array) -> Array:
        base = found.base.copy()
        base[:3, :3] = base[:3, :3] @ Rotation.from_rotvec(y[3:6] / 1e3).as_matrix()
        base[:3, 3] += y[:3]
        return (reflector(replace(found, base=base), q, point + y[6:]) - true).ravel()

    left = least_squares(fitted, np.zeros(9)).fun.reshape(-1, 3)
    return _rms(off), _rms(left)


def _point(nominal: Array, truth: object) -> Array:
    assert isinstance(truth, dict)
    return nominal + np.array([truth.get(f"reflector_P_{axis}", 0.0) for axis in "xyz"])


def _rms(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


# --------------------------------------------------------------------------------------------------------- the runs


def first_files(folder: Path, *, stated: bool = True) -> Path:
    """What `symcal init` writes for a UR5e and a tracker, with the noise stated or not; the experiment."""
    write_first_files(of_arm("ur5e"), draft_named("tracker"), folder)
    file = folder / "experiment.yaml"
    text = file.read_text()
    if stated:
        assert "target: reflector}" in text
        text = text.replace("target: reflector}", f"target: reflector, noise: {{position: {NOISE}}}}}")
    file.write_text(text)
    return file


def planned(folder: Path, *, stated: bool = True) -> Path:
    """A plan of forty poses, as a user would make it; its folder."""
    (folder / "first").mkdir()
    quiet = ("outputs.figures=false", "outputs.report=false", "plan.promise.random=1")
    run_plan(first_files(folder / "first", stated=stated), folder / "plan", overrides=quiet)
    return folder / "plan"


def quick_plan(folder: Path, *, stated: bool = True) -> Path:
    """Forty poses with many joints at their limits, as a plan's folder has them: nobody has chosen them."""
    plan = folder / "plan"
    plan.mkdir()
    file = first_files(plan, stated=stated).rename(plan / "experiment.resolved.yaml")
    experiment = load(file)
    problem = plan_problem(experiment.file, experiment.document, experiment.model, np.random.default_rng(1))
    poses = draw(problem.area, np.random.default_rng(2), 40, problem.feasible, share=0.4)
    write_plan(plan / "plan.csv", experiment.robot, poses)
    return plan


def run(aim: Aim, seed: int, order: Order, mishaps: Mishaps) -> Run:
    there = simulated(aim, seed, mishaps)
    course, end, known = lead(aim, there, order)
    error, fitted = (np.nan, np.nan) if known is None else errors(aim, there, known)
    return Run(course, end, known, error, fitted)


def _share(hits: int, of: int) -> str:
    low, high = binomtest(hits, of).proportion_ci(0.95, "exact") if of else (0.0, 1.0)
    return f"{hits} of {of} ({100 * hits / max(of, 1):.1f} %, 95 % sure {100 * low:.1f} to {100 * high:.1f} %)"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("runs", type=int, nargs="?", default=100)
    parser.add_argument("order", choices=("best", "plan"), nargs="?", default="best")
    parser.add_argument("noise", choices=("stated", "estimated"), nargs="?", default="stated")
    parser.add_argument("--bump", type=float, help="mm, before the tenth reading")
    parser.add_argument("--base", action="store_true", help="the base is bumped, not the reflector")
    parser.add_argument("--at", type=int, default=10)
    parser.add_argument("--slips", type=float, default=0.0)
    parser.add_argument("--plan", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch, one_thread():
        plan = given.plan or planned(Path(scratch), stated=given.noise == "stated")
        aim = aim_of(plan, TOLERANCE)
        moves = "base" if given.base else "target"
        bump = None if given.bump is None else given.at
        mishaps = Mishaps(given.slips, given.slips, bump=bump, by=given.bump or 0.0, moves=moves)  # type: ignore[arg-type]
        found = [run(aim, seed, given.order, mishaps) for seed in range(given.runs)]
    if bump is not None:
        told = [each.course.moved is not None for each in found]
        late = [each.requests - bump + 1 for each, seen in zip(found, told, strict=True) if seen]
        poses = [_poses_after(each, bump) for each, seen in zip(found, told, strict=True) if seen]
        print(f"bump of {given.bump} mm told: {_share(sum(told), len(found))}; readings until then {sorted(late)}")
        print(f"new poses until then: at most two in {_share(sum(p <= 2 for p in poses), len(found))}")
        return
    reached = [each for each in found if each.outlook.ending == "reached"]
    others = [each.outlook.ending for each in found if each.outlook.ending != "reached"]
    print(f"reached: {_share(len(reached), len(found))}; others {others}")
    for name in ("error", "fitted"):
        values = np.array([getattr(each, name) for each in reached])
        words = "as identified" if name == "error" else "frames fitted"
        print(f"{words}: kept in {_share(int((values <= TOLERANCE).sum()), len(values))}; worst {values.max():.4f} mm")
    for what, counts in (
        ("poses", np.array([len({r.pose for r in each.course.readings}) for each in found])),
        ("readings", np.array([each.requests for each in found])),
    ):
        print(f"{what}: median {np.median(counts):g}, 95 % within {np.quantile(counts, 0.95)}, most {counts.max()}")
    again = [sum(r.of.asked != "pose" for r in each.course.readings) for each in found]
    print(f"readings beside the plan's: {sum(again)} in {len(found)} runs")


def _poses_after(each: Run, bump: int) -> int:
    """Poses that were new when something stood elsewhere already."""
    return len({r.pose for r in each.course.readings if r.number >= bump and r.of.asked == "pose"})


if __name__ == "__main__":
    main()
