"""Draws of simulated elastic and wavy arms through `extend: auto`:  python tests/extension_draws.py N [CASE ...]

A 6-axis arm (the UR5 of the configs on another wrist, or as it is), one reflector, tracker and reflector unknown,
0.05 mm noise per axis. The witness is the Cramer-Rao bound of the true model, from its own Jacobian.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from symcal.calibration import extend
from symcal.calibration.extend import Extended, calibrate_extended
from symcal.calibration.identify import baseline_model
from symcal.calibration.simulate import simulate
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.joints import Term
from symcal.joints.arm import Payload
from symcal.joints.compliance import Compliance
from symcal.joints.harmonics import Harmonics
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.robot.robot import Robot, load_robot

CONFIGS = Path(__file__).parents[1] / "configs"
NOISE = 0.05
TEST = 300


@dataclass(frozen=True)
class Case:
    """wave: amplitude of the first harmonics at joints 1 and 3, rad. compliance: of joints 2 and 3, rad/(N mm)."""

    wave: float = 0.0
    compliance: float = 0.0
    poses: int = 100
    range_share: float = 0.85


CASES = {
    "physics": Case(0.5e-3, 2e-8),
    "small": Case(0.2e-3, 0.0),
    "nothing": Case(),
    "half": Case(0.5e-3, 0.0, 40, 0.5),
    "narrow": Case(0.5e-3, 0.0, 30, 0.1),
    "nothing_half": Case(0.0, 0.0, 40, 0.5),
    "nothing_narrow": Case(0.0, 0.0, 30, 0.1),
}


def arm() -> Robot:
    """The UR5, its joints limited, a reflector 60 mm off the last axis and 100 mm in front of the flange."""
    robot = load_robot(CONFIGS / "robots" / "ur5.yaml")
    tool = np.eye(4)
    tool[:3, 3] = [60.0, 0.0, 100.0]
    links = tuple(replace(link, joint=replace(link.joint, lower=-2.9, upper=2.9)) for link in robot.links)
    return replace(robot, links=links, tool=tool)


@cache
def models(case: Case) -> tuple[Model, Model]:
    """Of the arm without joint terms, and of the true one."""
    robot = arm()
    task = Task.of("position", ("base", "tool"), {"P": (0.0, 0.0, 0.0)})
    terms: list[Term] = []
    if case.wave:
        terms += [Harmonics(j, True, k=(1,)) for j in (1, 3)]
    if case.compliance:
        terms += [Compliance(j, True) for j in (2, 3)]
    true = replace(robot, terms=tuple(terms), payload=Payload(5.0))
    return build_model(robot, task), build_model(true, task)


@dataclass(frozen=True)
class Draw:
    extended: Extended
    truth: dict[str, float]
    squared_error: float
    bound: float


def draw(case: Case, seed: int) -> Draw:
    """One simulated robot, measured and identified."""
    rng = np.random.default_rng(seed)
    model, true = models(case)
    truth = {
        p.name: float(rng.normal()) * p.scale * 0.3 for p in true.parameters.items if not p.group and not p.unknown
    }
    truth |= {
        p.name: float(rng.normal()) * (10.0 if p.unit == "mm" else 0.01) for p in true.parameters.items if p.unknown
    }
    for p in true.parameters.items:
        if p.group == "gravity":
            truth[p.name] = case.compliance
    for joint in (1, 3) if case.wave else ():
        phase = rng.uniform(-np.pi, np.pi)
        truth[f"q{joint}_sin_1"], truth[f"q{joint}_cos_1"] = case.wave * np.cos(phase), case.wave * np.sin(phase)
    lower, upper = model.robot.ranges
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    centre = middle if case.range_share > 0.5 else middle + rng.uniform(-0.4, 0.4, 6) * half
    q = centre + rng.uniform(-1, 1, (case.poses, 6)) * half * case.range_share
    data = simulate(true, truth, q, Noise("normal", NOISE), rng)
    found = calibrate_extended(model, baseline_model(model), data, Options(), ("auto",))
    test = centre + rng.uniform(-1, 1, (TEST, 6)) * half * case.range_share
    x = true.parameters.vector(truth)
    at, slopes = true.points(test, x, true.setup.vector)
    calibration = found.calibration
    own, _ = calibration.model.points(test, calibration.after.x, calibration.setup.vector)
    squared = float(np.mean(np.sum((own - at) ** 2, axis=1)))
    _, seen = true.points(q, x, true.setup.vector)
    scales = true.parameters.scales
    rows = np.vstack([(seen * scales).reshape(-1, len(scales)) / NOISE, np.eye(len(scales)) * 1e-3])
    triangle = np.linalg.qr(rows, mode="r")
    spread = np.linalg.solve(triangle.T, (slopes * scales).reshape(-1, len(scales)).T)
    return Draw(found, truth, squared, float(np.sum(spread**2)) / TEST)


def main() -> None:
    count, names = int(sys.argv[1]), sys.argv[2:] or list(CASES)
    extend.with_terms = _cached(extend.with_terms)  # type: ignore[assignment]
    for name in names:
        report(name, CASES[name], [draw(CASES[name], seed) for seed in range(count)])


def _cached(make):  # type: ignore[no-untyped-def]
    known: dict[object, Model] = {}

    def found(model: Model, terms: tuple[Term, ...]) -> Model:
        key = (id(model), tuple(term.name(label) for term in terms for label in term.labels))
        if key not in known:
            known[key] = make(model, terms)
        return known[key]

    return found


def report(name: str, case: Case, draws: list[Draw]) -> None:
    kept = {
        g.name: sum(d.extended.extension.groups[i].kept for d in draws)
        for i, g in enumerate(draws[0].extended.extension.groups)
    }
    print(f"{name}: {len(draws)} draws; kept {kept}")
    true = {"harmonics 1": {1, 3} if case.wave else set(), "gravity": {2, 3} if case.compliance else set()}
    false_group = sum(any(g.kept and not true.get(g.name) for g in d.extended.extension.groups) for d in draws)
    named = [
        {(g.name, j.joint) for g in d.extended.extension.groups if g.kept for j in g.joints if j.named} for d in draws
    ]
    print(
        f"  false group {false_group}; every named joint: { {pair: sum(pair in n for n in named) for pair in sorted(set().union(*named))} }"
    )
    all_named = sum({("harmonics 1", j) for j in true["harmonics 1"]} <= n for n in named)
    print(f"  harmonics of 1 and 3 both named in {all_named}")
    error, bound = (np.array([getattr(d, key) for d in draws]) for key in ("squared_error", "bound"))
    print(
        f"  rms to truth, pooled, over Cramer-Rao of the true model {np.sqrt(error.mean() / bound.mean()):.3f} (rms {np.sqrt(error.mean()):.4f} mm)"
    )
    if case.wave:
        good = strong = 0
        for d in draws:
            waves = [
                j for g in d.extended.extension.groups if g.name == "harmonics 1" for j in g.joints if j.joint in (1, 3)
            ]
            off = []
            for j in waves:
                s, c = d.truth[f"q{j.joint}_sin_1"], d.truth[f"q{j.joint}_cos_1"]
                phase = np.arctan2(c, s)
                off.append(abs(j.amplitude - np.hypot(s, c)) / j.amplitude_sigma)
                off.append(abs((j.phase - phase + np.pi) % (2 * np.pi) - np.pi) / j.phase_sigma)
            good += max(off) < 3
            strong += all(j.amplitude > 5 * j.amplitude_sigma for j in waves)
        print(f"  amplitude and phase within 3 sigma in {good}, above 5 sigma in {strong}")


if __name__ == "__main__":
    main()
