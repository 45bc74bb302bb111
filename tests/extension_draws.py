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
from symcal.calibration.calibrate import Calibration, baseline_model
from symcal.calibration.extend import calibrate_extended
from symcal.calibration.simulate import simulate
from symcal.fit.estimation import Options
from symcal.instruments.noise import Noise
from symcal.joints import Term
from symcal.joints.arm import Payload
from symcal.joints.compliance import Compliance
from symcal.joints.harmonics import Harmonics
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.robot.files import load_robot
from symcal.robot.robot import Robot

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
    calibration: Calibration
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
    own, _ = found.model.points(test, found.after.x, found.setup.vector)
    squared = float(np.mean(np.sum((own - at) ** 2, axis=1)))
    _, seen = true.points(q, x, true.setup.vector)
    scales = true.parameters.scales
    rows = np.vstack([(seen * scales).reshape(-1, len(scales)) / NOISE, np.eye(len(scales)) * 1e-3])
    triangle = np.linalg.qr(rows, mode="r")
    spread = np.linalg.solve(triangle.T, (slopes * scales).reshape(-1, len(scales)).T)
    return Draw(found, truth, squared, float(np.sum(spread**2)) / TEST)


def true_values(found: Draw, joint: int) -> tuple[float, float]:
    """Amplitude and phase of a first harmonic."""
    sine, cosine = found.truth[f"q{joint}_sin_1"], found.truth[f"q{joint}_cos_1"]
    return float(np.hypot(sine, cosine)), float(np.arctan2(cosine, sine))


def main() -> None:
    count, names = int(sys.argv[1]), sys.argv[2:] or list(CASES)
    extend.with_terms = _cached(extend.with_terms)  # type: ignore[assignment]
    for name in names:
        report(name, CASES[name], [draw(CASES[name], seed) for seed in range(count)])


def _cached(make):  # type: ignore[no-untyped-def]
    """Models of the same terms are built once."""
    known: dict[object, Model] = {}

    def found(model: Model, terms: tuple[Term, ...]) -> Model:
        key = (id(model), tuple(term.name(label) for term in terms for label in term.labels))
        if key not in known:
            known[key] = make(model, terms)
        return known[key]

    return found


def report(name: str, case: Case, draws: list[Draw]) -> None:
    """Print how often groups were kept and joints named, and errors over the bound."""
    found = [d.calibration.extension for d in draws]
    true = {"harmonics 1": {1, 3} if case.wave else set(), "gravity": {2, 3} if case.compliance else set()}
    kept = {g.name: sum(g.name in e.kept for e in found) for g in found[0].groups}
    named = [{(g.name, j.joint) for g in e.groups if g.kept for j in g.joints if j.named} for e in found]
    counts = {pair: sum(pair in n for n in named) for pair in sorted(set().union(*named))}
    false = sum(any(not true.get(group) for group in e.kept) for e in found)
    right = sum({(group, joint) for group, joints in true.items() for joint in joints} <= n for n in named)
    error, bound = (np.mean([getattr(d, key) for d in draws]) for key in ("squared_error", "bound"))
    say(f"{name}: {len(draws)} draws; kept {kept}; a false group in {false}; all true joints named in {right}")
    say(f"  named: {counts}")
    say(f"  rms to truth, pooled, over Cramer-Rao of the true model {np.sqrt(error / bound):.3f}")
    if not case.wave:
        return
    good = strong = 0
    for d in draws:
        waves = [j for g in d.calibration.extension.groups if g.name == "harmonics 1" for j in g.joints]
        waves = [j for j in waves if j.joint in (1, 3) and j.phase is not None]
        off = []
        for j in waves:
            amplitude, phase = true_values(d, j.joint)
            off.append(abs(j.amplitude - amplitude) / j.amplitude_sigma)
            off.append(abs((j.phase - phase + np.pi) % (2 * np.pi) - np.pi) / j.phase_sigma)
        good += max(off, default=np.inf) < 3
        strong += len(waves) == 2 and all(j.amplitude > 5 * j.amplitude_sigma for j in waves)
    say(f"  amplitude and phase within 3 sigma in {good}, amplitude above 5 sigma in {strong}")


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
