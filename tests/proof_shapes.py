"""Proven bounds against the largest values that searches find of a kinematics of its own, on arms of many shapes.

    python tests/proof_shapes.py [cases]      names of cases; all when none is given

`over` is the largest value found in parts of the bound, below zero; `loose` what the bound leaves above it beyond its
slack. `best` and `ceiling` are log det of the best design that brute force finds, and the bound of it by a design that
is far from the best one.
"""

# ruff: noqa: T201
from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import dual_annealing, minimize

from symcal import kinematics
from symcal.errors import RefusedError
from symcal.model.measurement import Setup
from symcal.model.observe import observe
from symcal.model.parameter_set import parameter_set
from symcal.model.task import Task
from symcal.planning.area import WorkingArea
from symcal.planning.information import PoseInformation, pose_information
from symcal.planning.proof.branch_and_bound import WORK, Bound
from symcal.planning.proof.proof import SLACK, logdet_ceiling, maximum
from symcal.robot.robot import Joint, Link, Robot

Array = NDArray[np.float64]
Kind = Literal["position", "pose"]

_STEP = 1e-30  # of derivatives by a complex step: nothing is subtracted


@dataclass(frozen=True)
class Case:
    """A measurement of an arm. sigmas: of every component, in the axes of world, or of the tool if turned round."""

    robot: Robot
    kind: Kind
    sigmas: tuple[float, ...]
    base: bool = False
    tool: bool = False
    points: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    turned: bool = False
    area: WorkingArea | None = None
    ground: float = 0.0

    def information(self) -> PoseInformation:
        """As the package has it."""
        position = self.kind == "position"
        points = {f"P{i}": point for i, point in enumerate(self.points)} if position else None
        task = Task.of(self.kind, points=points, invert=self.turned)
        (one,) = task.observations
        uneven = len(set(self.sigmas[:3])) > 1
        if uneven:
            one = replace(one, per_axis=True)
        tool: Literal["frame", "position"] | None = (
            None if not self.tool else "frame" if self.kind == "pose" else "position"
        )
        parameters = parameter_set(self.robot, base=self.base, tool=tool)
        measurement = observe(kinematics.chain(self.robot, parameters), one)
        at = np.array(self.points) if position else None
        setup = Setup(self.robot.base, self.robot.tool, at) if position else Setup(self.robot.base, self.robot.tool)
        per_group = {
            group.name: self.sigmas[min(c for c in group.columns) % len(self.sigmas)] for group in measurement.groups
        }
        prior = None if not self.ground else np.eye(1, len(parameters)) / self.ground
        return pose_information(measurement, setup, per_group, area=self.area, prior_rows=prior)

    def rows(self, names: tuple[str, ...], q: Array) -> Array:
        """Whitened derivatives of what is read by parameters, shape (components, p)."""
        columns = []
        here = self._frame(q, {})
        for name in names:
            there = self._frame(q, {name: 1j * _STEP})
            columns.append(self._read(here, there))
        sigmas = np.tile(self.sigmas, len(self.points) if self.kind == "position" else 1)
        return np.array(columns).T / sigmas[:, None]

    def _read(self, here: Array, there: Array) -> Array:
        if self.turned:
            here, there = _inverse(here), _inverse(there)
        if self.kind == "position":
            at = np.array([[*point, 1.0] for point in self.points])
            return np.concatenate([(there @ point)[:3].imag for point in at]) / _STEP
        spin = there[:3, :3].imag @ here[:3, :3].real.T / _STEP
        return np.concatenate([there[:3, 3].imag / _STEP, [spin[2, 1], spin[0, 2], spin[1, 0]]])

    def _frame(self, q: Array, step: dict[str, complex]) -> Array:
        """Of the tool in world: Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta), or Rx Tx Ry Rz Tz."""
        out = self.robot.base.astype(complex) @ _increment("base", step)
        for i, (link, reading) in enumerate(zip(self.robot.links, q, strict=True), start=1):
            value = {
                key: link.parameters.get(key, 0.0) + step.get(f"{key}_{i}", 0.0)
                for key in ("theta", "d", "a", "alpha", "beta")
            }
            joint = link.joint
            value["theta" if joint.revolute else "d"] += joint.sign * joint.ratio * reading + joint.offset
            theta, d = _turn(2, value["theta"]), _shift(2, value["d"])
            a, alpha, beta = _shift(0, value["a"]), _turn(0, value["alpha"]), _turn(1, value["beta"])
            order = (theta, d, a, alpha, beta) if self.robot.convention == "standard" else (alpha, a, beta, theta, d)
            for each in order:
                out = out @ each
        return out @ self.robot.tool @ _increment("tool", step)


def _turn(axis: int, angle: complex) -> Array:
    out, (i, j) = np.eye(4, dtype=complex), [(1, 2), (2, 0), (0, 1)][axis]
    out[i, i] = out[j, j] = np.cos(angle)
    out[i, j], out[j, i] = -np.sin(angle), np.sin(angle)
    return out


def _shift(axis: int, length: complex) -> Array:
    out = np.eye(4, dtype=complex)
    out[axis, 3] = length
    return out


def _increment(of: str, step: dict[str, complex]) -> Array:
    out = np.eye(4, dtype=complex)
    out[:3, 3] = [step.get(f"{of}_{axis}", 0.0) for axis in "xyz"]
    x, y, z = (step.get(f"{of}_r{axis}", 0.0) for axis in "xyz")
    out[:3, :3] += np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return out


def _inverse(frame: Array) -> Array:
    out = np.eye(4, dtype=complex)
    out[:3, :3] = frame[:3, :3].T
    out[:3, 3] = -frame[:3, :3].T @ frame[:3, 3]
    return out


def _arm(
    shape: str, seed: int, convention: str, span: float, ratios: tuple[float, ...] = (1.0,), middle: float = 0.0
) -> Robot:
    """`RRPR`, with random links; signs and offsets of joints are random where gears are."""
    rng = np.random.default_rng(seed)
    links = []
    for i, kind in enumerate(shape):
        revolute = kind == "R"
        gear = ratios[i % len(ratios)]
        geared = len(ratios) > 1
        limits = (middle - span, middle + span) if revolute else (50.0, 450.0)
        joint = Joint(
            "revolute" if revolute else "prismatic",
            f"j{i}",
            limits[0] / gear,
            limits[1] / gear,
            sign=int(rng.choice([-1, 1])) if geared else 1,
            ratio=gear,
            offset=float(rng.uniform(-1, 1)) if geared else 0.0,
        )
        own = {
            "alpha": float(rng.choice([0.0, math.pi / 2, -math.pi / 2]) + 0.1 * rng.normal()),
            "a": float(rng.uniform(50, 400)),
            "d": float(rng.uniform(50, 300)) if revolute else 0.0,
        }
        links.append(Link(joint, own | ({"theta": 0.0} if revolute else {})))
    base, tool = np.eye(4), np.eye(4)
    base[:3, :3] = (_turn(0, 0.3) @ _turn(2, 0.4)).real[:3, :3]
    base[:3, 3], tool[:3, 3] = [300.0, -200.0, 100.0], rng.uniform(30, 150, 3)
    return Robot(shape.lower(), convention, tuple(links), base=base, tool=tool)


_FRAME = (0.5, 0.5, 0.5, 0.002, 0.002, 0.002)
_AXES = (0.05, 0.1, 0.3)
_TWO = ((0.0, 0.0, 0.0), (40.0, -20.0, 60.0))

CASES: dict[str, Callable[[], Case]] = {
    "5R standard, pose": lambda: Case(_arm("RRRRR", 1, "standard", 2.8), "pose", _FRAME, tool=True),
    "5R craig, position, base unknown": lambda: Case(_arm("RRRRR", 2, "craig", 2.0), "position", (0.1,) * 3, base=True),
    "RPRPR craig, gears, noise by axis, two points": lambda: Case(
        _arm("RPRPR", 3, "craig", 2.5, (0.5, 2.0, 3.0)), "position", _AXES, points=_TWO
    ),
    "4R, beyond whole circles, gears": lambda: Case(
        _arm("RRRR", 4, "standard", 8.0, (2.0, 1.0, 0.5)), "position", (0.1,) * 3
    ),
    "4R, narrow": lambda: Case(_arm("RRRR", 5, "craig", 0.2, middle=0.7), "position", (0.01,) * 3),
    "4R, within a degree": lambda: Case(_arm("RRRR", 5, "craig", 0.02, middle=0.7), "position", (0.01,) * 3),
    "PPRR, noise by axis, base unknown": lambda: Case(_arm("PPRR", 6, "standard", 2.9), "position", _AXES, base=True),
    "6R, narrow, pose turned round, base and tool unknown": lambda: Case(
        _arm("RRRRRR", 7, "standard", 0.5, middle=-0.4), "pose", _FRAME, base=True, tool=True, turned=True
    ),
    "4R, a prior": lambda: Case(_arm("RRRR", 8, "standard", 1.5), "position", (0.1,) * 3, ground=2e-4),
    "6R craig, position": lambda: Case(_arm("RRRRRR", 9, "craig", 1.0), "position", (0.1,) * 3),
}


@dataclass(frozen=True)
class Found:
    """bound: proven. joints: that matter. value: the largest that searches found, at rows of the package and of our own
    kinematics. best: log det of the best design that brute force finds; ceiling: its bound."""

    bound: Bound
    joints: int
    value: float
    own: float
    best: float
    ceiling: float
    seconds: float


def tried(case: Case, rng: np.random.Generator, *, thorough: bool = True, work: int = WORK) -> Found:
    """A weight from a poor design, the bound of its trace, and searches for a value that exceeds it."""
    info = case.information()
    lower, upper = info.area.lower, info.area.upper
    poor = info.area.sample(rng, 30)
    weight = np.linalg.inv(info.total(poor) / len(poor))
    weight = 0.5 * (weight + weight.T)
    sample = np.concatenate([info.area.sample(rng, 20_000 if thorough else 3000), info.area.snapped(rng, 5000)])
    values = info.function.weighted(sample, weight)
    began = time.process_time()
    bound, joints = maximum(info, weight, float(values[:50].max()), rng, work)  # a search that misses nearly everything
    seconds = time.process_time() - began

    def trace(q: Array) -> float:
        return -float(info.function.weighted(np.clip(q, lower, upper)[None], weight)[0]) / bound.upper

    box = list(zip(lower, upper, strict=True))
    size = upper - lower
    best, where = 0.0, sample[0]
    for start in sample[np.argsort(values)[-(40 if thorough else 8) :]]:
        end = minimize(lambda t: trace(lower + t * size), (start - lower) / size, bounds=[(0, 1)] * len(box))
        if -end.fun > best:
            best, where = -float(end.fun), lower + np.clip(end.x, 0, 1) * size
    if thorough:
        end = dual_annealing(trace, box, maxfun=4000, rng=np.random.default_rng(1))
        if -end.fun > best:
            best, where = -float(end.fun), np.asarray(end.x)
    rows = case.rows(tuple(info.names), where) * info.scales @ info.basis
    ground = info.prior / len(poor)
    reached = _brute_force(info, np.concatenate([sample[:: 10 if thorough else 20], where[None]]), ground)
    ceiling = logdet_ceiling(weight, bound.upper, ground)
    return Found(bound, joints, best, float(np.trace(rows @ weight @ rows.T)) / bound.upper, reached, ceiling, seconds)


def _brute_force(info: PoseInformation, sample: Array, ground: Array, rounds: int = 300) -> float:
    """log det of the best design on a sample, by the multiplicative algorithm."""
    rows = info.function.rows(sample)
    every = np.einsum("kmi,kmj->kij", rows, rows)
    share = np.full(len(sample), 1.0 / len(sample))
    for _ in range(rounds):
        inverse = np.linalg.inv(np.einsum("k,kij->ij", share, every) + ground)
        gain = np.einsum("kij,ij->k", every, inverse)
        share *= gain / (share @ gain)
    return float(np.linalg.slogdet(np.einsum("k,kij->ij", share, every) + ground)[1])


def main(wanted: list[str]) -> None:
    """A line per case."""
    print(
        f"{'':54}{'joints':>7}{'n':>4}{'over':>10}{'own':>10}{'loose':>9}{'rounding':>10}{'open':>8}{'boxes':>8}{'s':>7}",
        end="",
    )
    print(f"{'best':>9}{'ceiling':>9}")
    for name in wanted or CASES:
        try:
            found = tried(CASES[name](), np.random.default_rng(3))
        except RefusedError as error:
            print(f"{name:54}not proven: {error}", flush=True)
            continue
        loose = 1 - found.value - SLACK
        bound = found.bound
        print(
            f"{name:54}{found.joints:7}{CASES[name]().information().rank:4}{found.value - 1:10.1e}{found.own - 1:10.1e}"
            f"{loose:9.1e}{bound.rounding / bound.upper:10.0e}{bound.open_share:8.2%}{bound.boxes:8}"
            f"{found.seconds:7.2f}{found.best:9.3f}{found.ceiling:9.3f}",
            flush=True,
        )
        assert found.value <= 1.0
        assert found.own <= 1.0 + 1e-9
        assert found.best <= found.ceiling


if __name__ == "__main__":
    main(sys.argv[1:])
