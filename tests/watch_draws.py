"""Checks of simulated robots in service: how often `symcal watch` raises a false alarm, and what it finds and names.

    python tests/watch_draws.py [runs] [mm off the last axis] [poses] [random or planned]

is the long form of test_watch.py: 500 runs, 60 mm, 10 poses of the check, calibrated by 40 random ones.

Every run draws a UR5e with its own errors (1 mm, 0.3 deg) and tracker (0.05 mm, base and point unknown: the first files
of `symcal init --arm ur5e --instrument tracker`), calibrates it by 40 poses, random ones or those of
their plan, plans the poses of a check by that calibration, and measures them with something changed. Everything is done
as the commands do it, from the calibrated robot alone; the truth is known to the simulation only.
"""

# ruff: noqa: T201

from __future__ import annotations

import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import stats
from strategies import random_frame

from symcal import spatial
from symcal.calibration.calibrate import calibrate
from symcal.calibration.record import recorded_task
from symcal.calibration.simulate import simulate
from symcal.data.dataset import Dataset
from symcal.drafts.files import write_first_files
from symcal.drafts.instrument import draft_named
from symcal.drafts.robot_file import of_arm
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.model.model import Model
from symcal.planning.area import WorkingArea
from symcal.planning.plan_problem import plan_problem
from symcal.planning.sampling import feasible_poses
from symcal.robot.robot import Robot
from symcal.runs.load import load
from symcal.runs.plan import plan_experiment
from symcal.watch.check import Check, check
from symcal.watch.plan import plan_check
from symcal.watch.reference import Reference, reference_of

NOISE, OFFSET, POSES = 0.05, 5e-4, 10
ALPHA, OTHER = 0.01, 0.05
SIZES = {"mm": 1.0, "rad": np.deg2rad(0.3)}
"""Standard deviations of the robot's errors, as the first files have them."""

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
OFFSETS = dict.fromkeys(JOINTS, OFFSET)
CASES: dict[str, tuple[bool, dict[str, float]]] = {
    "nothing": (False, {}),
    **{f"{name} 0.5 mrad": (False, {f"theta_{i}": OFFSET}) for i, name in enumerate(JOINTS, start=1)},
    "base 0.3 mm, 0.3 mrad": (False, {"base": 0.3}),
    "tool 0.3 mm": (False, {"tool": 0.3}),
    "slip of 0.3 mm": (False, {"slip": 0.3}),
    "slip of 1 mm": (False, {"slip": 1.0}),
    "slip of 1 mm, elbow 1 mrad": (False, {"slip": 1.0, "theta_3": 1e-3}),
    "set up anew, nothing": (True, {}),
    **{f"set up anew, {JOINTS[i - 1]} 1 mrad": (True, {f"theta_{i}": 1e-3}) for i in (1, 2, 3, 4, 5)},
}
"""By name whether the instrument was set up anew, and what changed: offsets in rad; in mm a random shift of the base
(with a turn of as many mrad), of the point on the tool, of one reading."""


@dataclass(frozen=True)
class Cell:
    """The first files of the UR5e: model, where poses may be, and poses that can be measured, shape (K, dof).

    planned: the poses of their own plan, by which every robot is calibrated; by random ones when None.
    """

    model: Model
    area: WorkingArea
    pool: np.ndarray
    planned: np.ndarray | None = None


@dataclass(frozen=True)
class Service:
    """A calibrated robot with its planned check, and the truth behind it. base: where the tracker sees it."""

    cell: Cell
    reference: Reference
    q: np.ndarray
    truth: dict[str, float]
    base: np.ndarray


def cell(off_axis: float = 60.0, *, planned: bool = False) -> Cell:
    """Args: off_axis: of the point from the last axis, mm. planned: whether robots are calibrated by a plan's poses."""
    with tempfile.TemporaryDirectory() as folder:
        write_first_files(of_arm("ur5e"), draft_named("tracker"), Path(folder))
        path = Path(folder) / "experiment.yaml"
        text = path.read_text(encoding="utf-8")
        assert "near: [60, 0, 40]" in text
        path.write_text(text.replace("near: [60, 0, 40]", f"near: [{off_axis}, 0, 40]"), encoding="utf-8")
        found = load(path)
        rng = np.random.default_rng(0)
        problem = plan_problem(found.file, found.document, found.model, rng)
        pool = feasible_poses(rng, problem.area, problem.measuring, 4000, snap=0.4)
        poses = plan_experiment(found).findings.planned.plan.poses if planned else None
        return Cell(found.model, problem.area, pool, poses)


def measured(cell: Cell, truth: dict[str, float], base: np.ndarray, q: np.ndarray, rng: np.random.Generator) -> Dataset:
    there = replace(cell.model, setup=replace(cell.model.setup, base=base))
    return simulate(there, truth, q, Noise("normal", NOISE), rng)


def in_service(cell: Cell, seed: int, poses: int = POSES, pool: int = 300) -> Service:
    """A robot, its calibration by 40 poses, and the poses of its check."""
    rng = np.random.default_rng([seed, 18])
    links = cell.model.robot.parameters
    truth = {p.name: float(rng.normal() * SIZES[p.unit]) for p in cell.model.parameters.items if p.name in links}
    truth |= {name: float(rng.normal()) for name in cell.model.parameters.names if name.startswith("reflector")}
    base = random_frame(rng, 1000.0)
    random = cell.pool[rng.choice(len(cell.pool), 40, replace=False)]
    q = random if cell.planned is None else cell.planned
    robot = calibrate(cell.model, None, measured(cell, truth, base, q, rng), Options()).robot
    reference = referred(robot)
    some = cell.pool[rng.choice(len(cell.pool), pool, replace=False)]
    plan = plan_check(reference, some, cell.area, poses, offsets=OFFSETS, alpha=0.01, moved=False)
    return Service(cell, reference, plan.poses, truth, base)


def referred(robot: Robot) -> Reference:
    assert robot.record is not None
    return reference_of(robot, recorded_task(robot.record.provenance, "after", Path()).observations, Path())


def today(service: Service, moved: bool, changed: dict[str, float], rng: np.random.Generator) -> Dataset:
    """The readings of a check with something changed."""
    truth, base = dict(service.truth), random_frame(rng, 1000.0) if moved else service.base
    if "base" in changed:
        base = nudged(base, changed["base"], rng)
    if "tool" in changed:
        shift = changed["tool"] * unit(rng)
        truth |= {f"reflector_P_{axis}": truth[f"reflector_P_{axis}"] + d for axis, d in zip("xyz", shift, strict=True)}
    sign = rng.choice([-1.0, 1.0])
    truth |= {name: truth[name] + sign * value for name, value in changed.items() if name.startswith("theta")}
    data = measured(service.cell, truth, base, service.q, rng)
    if "slip" in changed:
        z = data.z.copy()
        z[rng.integers(len(z))] += changed["slip"] * unit(rng)
        return replace(data, z=z)
    return data


def checked(service: Service, data: Dataset, alpha: float = ALPHA, *, moved: bool = False) -> Check:
    return check(service.reference, data, alpha=alpha, offsets=OFFSETS, moved=moved)


def nudged(base: np.ndarray, size: float, rng: np.random.Generator) -> np.ndarray:
    """A base shifted by so many mm and turned by so many mrad, each in a random direction."""
    turn = spatial.vector_matrix(1e-3 * size * unit(rng))
    return np.asarray(base @ spatial.transform(turn, size * unit(rng)))


def unit(rng: np.random.Generator) -> np.ndarray:
    direction = rng.normal(size=3)
    return np.asarray(direction / np.linalg.norm(direction))


def checks(
    cell: Cell, runs: range, cases: dict[str, tuple[bool, dict[str, float]]], poses: int = POSES
) -> Iterator[tuple[str, Check]]:
    """Every case once for every run; by name, with the rate of false alarms where it is not 1 %."""
    for seed in runs:
        service = in_service(cell, seed, poses)
        for k, (name, (moved, changed)) in enumerate(cases.items()):
            data = today(service, moved, changed, np.random.default_rng([seed, 19, k]))
            yield name, checked(service, data, moved=moved)
            if not moved and all(part.startswith("theta") for part in changed):
                yield (
                    f"{name}, alpha {OTHER}",
                    checked(service, data, OTHER),
                )


def main(runs: int, off_axis: float, poses: int, calibrated_by: str) -> None:
    found: dict[str, list[Check]] = defaultdict(list)
    for name, each in checks(cell(off_axis, planned=calibrated_by == "planned"), range(runs), CASES, poses):
        found[name].append(each)
    print(
        f"{runs} runs, alpha {ALPHA}, point {off_axis:g} mm off the last axis; share of runs with an alarm, and names"
    )
    for alpha in (ALPHA, OTHER):
        low, high = stats.binom.ppf([0.025, 0.975], runs, alpha) / runs
        print(f"false alarms at alpha {alpha} as stated: {low:.3f} to {high:.3f}")
    for name, each in found.items():
        print(f"  {name}: {said(each)}", flush=True)


def said(each: list[Check]) -> str:
    alarms = [one for one in each if not one.holds]
    first = Counter(one.group[0].hypothesis.name if one.group else "no one change" for one in alarms)
    inside = Counter(change.hypothesis.name for one in alarms for change in one.group)
    alone = sum(len(one.group) == 1 for one in alarms) / len(each)
    slips = np.mean([one.gross is not None for one in each])
    return (
        f"{len(alarms) / len(each):.3f}; first {shares(first, len(each))}; in the group {shares(inside, len(each))}; "
        f"alone {alone:.3f}; a slip named {slips:.3f}"
    )


def shares(counts: Counter[str], runs: int) -> str:
    return ", ".join(f"{name} {count / runs:.3f}" for name, count in counts.most_common(4)) or "-"


if __name__ == "__main__":
    runs, off_axis, poses, calibrated_by = [*sys.argv[1:], *("500", "60", str(POSES), "random")[len(sys.argv) - 1 :]]
    main(int(runs), float(off_axis), int(poses), calibrated_by)
