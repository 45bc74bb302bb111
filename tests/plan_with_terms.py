"""What a plan for geometry, gravity and harmonics foretells against fits:  python tests/plan_with_terms.py N

A 6-axis arm whose robot file has gravity at joints 2, 3 and 5 and first harmonics everywhere, all zero; the plan is
D-optimal. Robots are drawn with the plausible sizes, simulated at the plan and identified; the errors at fresh poses of
the area are against the truth.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from extension_draws import NOISE, arm, say

from symcal.calibration.calibrate import baseline_model, calibrate
from symcal.calibration.candidates import gravity_terms
from symcal.calibration.simulate import simulate
from symcal.instruments.noise import Noise
from symcal.joints.harmonics import Harmonics
from symcal.robot.files import save_robot
from symcal.runs.load import load
from symcal.runs.plan import PlanOutcome, plan_experiment

EXPERIMENT = """
schema: symcal/experiment/1
name: plan_with_terms
seed: 3
units: {length: mm, angle: deg}
robot: robot.yaml
measurement: {type: position, points: {P: [0, 0, 0]}, estimate: [base, tool], noise: {position: 0.05}}
plan: {poses: 60, method: exchange, random: 0, compare: [], sample: 1000, promise: {counts: [60], random: 10}}
outputs: {report: false, figures: false}
"""


def planned(folder: Path) -> PlanOutcome:
    """The plan of the robot with terms."""
    robot = arm()
    terms = [term for term in gravity_terms(robot) if term.joint in (2, 3, 5)]
    terms += [Harmonics(j, True, k=(1,)) for j in range(1, 7)]
    save_robot(replace(robot, terms=tuple(terms)), folder / "robot.yaml")
    (folder / "experiment.yaml").write_text(EXPERIMENT, encoding="utf-8")
    return plan_experiment(load(folder / "experiment.yaml"))


def errors(outcome: PlanOutcome, count: int) -> np.ndarray:
    """Mean squared error to the truth over the area of every identified robot, mm^2."""
    experiment = outcome.experiment
    model, poses = experiment.model, outcome.findings.planned.plan.poses
    rng, baseline = np.random.default_rng(5), baseline_model(experiment.model)
    lower, upper = model.robot.ranges
    out = []
    for _ in range(count):
        sizes = np.array(
            [p.scale if not p.unknown else 1.0 if p.unit == "mm" else 1e-3 for p in model.parameters.items]
        )
        truth = model.parameters.mapping(rng.normal(size=len(sizes)) * sizes)
        data = simulate(model, truth, poses, Noise("normal", NOISE), rng)
        found = calibrate(model, baseline, data, experiment.options)
        test = rng.uniform(lower, upper, (200, model.robot.dof))
        wanted, _ = model.points(test, model.parameters.vector(truth), model.setup.vector)
        own, _ = model.points(test, found.after.x, found.setup.vector)
        out.append(np.mean(np.sum((own - wanted) ** 2, axis=1)))
    return np.array(out)


def foretold(outcome: PlanOutcome) -> float:
    """Mean rms error over the area that the plan foretells, mm."""
    found = outcome.findings
    problem = found.problem
    return float(found.accuracy.mean_rms(problem.info.posterior(found.planned.plan.poses)))


def main() -> None:
    with TemporaryDirectory() as folder:
        outcome = planned(Path(folder))
        found = errors(outcome, int(sys.argv[1]))
    say(f"foretold {foretold(outcome):.4f} mm, found {np.sqrt(found.mean()):.4f} mm rms over {len(found)} robots")
    say(f"ratio {np.sqrt(found.mean()) / foretold(outcome):.3f}")


if __name__ == "__main__":
    main()
