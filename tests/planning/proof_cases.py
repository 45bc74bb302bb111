"""Arms whose plans are proven, and a forward kinematics in mpmath that shares no code with the package."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np

from symcal import kinematics
from symcal.model.measurement import Setup
from symcal.model.observe import observe
from symcal.model.parameter_set import parameter_set
from symcal.model.task import Task
from symcal.planning.information import PoseInformation, pose_information
from symcal.robot.robot import Joint, Link, Robot

SIGMAS = {"position": {"position": 0.1}, "pose": {"position": 0.5, "orientation": 0.002}}


def arm(axes: int, seed: int, limit: float = 2.8, **joint) -> Robot:
    """Revolute joints with random links near right angles, and a tool that stands off."""
    rng = np.random.default_rng(seed)
    links = tuple(
        Link(
            Joint("revolute", f"j{i}", -limit, limit, **joint),
            {
                "theta": 0.0,
                "alpha": float(rng.choice([0.0, math.pi / 2, -math.pi / 2]) + 0.1 * rng.normal()),
                "a": float(rng.uniform(50, 400)),
                "d": float(rng.uniform(50, 300)),
            },
        )
        for i in range(1, axes + 1)
    )
    tool = np.eye(4)
    tool[:3, 3] = rng.uniform(30, 150, 3)
    return Robot(f"arm_{axes}", "standard", links, tool=tool)


def informed(robot: Robot, kind: str, *, base: bool = False, tool: bool = False, area=None) -> PoseInformation:
    """Information of positions of the tool's origin, or of its poses; base and tool known or not."""
    parameters = parameter_set(robot, base=base, tool="frame" if tool and kind == "pose" else None)
    measurement = observe(kinematics.chain(robot, parameters), *Task.of(kind).observations)
    setup = Setup(robot.base, robot.tool, np.zeros((1, 3))) if kind == "position" else Setup(robot.base, robot.tool)
    return pose_information(measurement, setup, SIGMAS[kind], area=area)


def exact_rows(info: PoseInformation, pose: np.ndarray) -> mp.matrix:
    """Sigma^-1/2 J S of a position at a pose by central differences of forty digits, (3, p)."""
    with mp.workdps(60):
        step = mp.mpf(10) ** -20
        columns = []
        for name, scale in zip(info.names, info.scales, strict=True):
            ends = [_position(info.measurement.chain.robot, pose, {name: sign * step}) for sign in (1, -1)]
            (sigma,) = info.sigmas.values()
            columns.append((ends[0] - ends[1]) / (2 * step) * mp.mpf(float(scale)) / mp.mpf(float(sigma)))
        return mp.matrix([[column[i] for column in columns] for i in range(3)])


def exact_trace(info: PoseInformation, pose: np.ndarray, weight: np.ndarray) -> mp.mpf:
    """tr(F W F^T) at a pose in forty digits."""
    with mp.workdps(40):
        rows = exact_rows(info, pose) * mp.matrix(info.basis.tolist())
        return mp.fsum((rows[i, :] * mp.matrix(weight.tolist()) * rows[i, :].T)[0] for i in range(3))


def _position(robot: Robot, pose: np.ndarray, errors: dict[str, mp.mpf]) -> mp.matrix:
    """Of the tool's origin in world; standard convention, base known or an increment of translation and rotation."""
    place = _frame(robot.base) * _increment([errors.get(f"base_{axis}", mp.mpf(0)) for axis in ("x", "y", "z")], errors)
    for i, (link, reading) in enumerate(zip(robot.links, pose, strict=True), start=1):
        value = {
            name: mp.mpf(float(link.parameters.get(name, 0.0))) + errors.get(f"{name}_{i}", mp.mpf(0))
            for name in ("theta", "d", "a", "alpha", "beta")
        }
        joint = link.joint
        model = joint.sign * mp.mpf(joint.ratio) * mp.mpf(float(reading)) + mp.mpf(joint.offset)
        value["theta" if joint.revolute else "d"] += model
        place *= _turn(2, value["theta"]) * _shift(2, value["d"]) * _shift(0, value["a"])
        place *= _turn(0, value["alpha"]) * _turn(1, value["beta"])
    return (place * _frame(robot.tool))[:3, 3]


def _frame(matrix: np.ndarray) -> mp.matrix:
    return mp.matrix(matrix.tolist())


def _increment(shift: list[mp.mpf], errors: dict[str, mp.mpf]) -> mp.matrix:
    turn = [errors.get(f"base_r{axis}", mp.mpf(0)) for axis in ("x", "y", "z")]
    skew = mp.matrix([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
    rotation = mp.eye(3) + skew + skew * skew / 2  # odd terms beyond the first are of the step's cube
    out = mp.eye(4)
    for i in range(3):
        out[i, 3] = shift[i]
        for j in range(3):
            out[i, j] = rotation[i, j]
    return out


def _turn(axis: int, angle: mp.mpf) -> mp.matrix:
    out, (i, j) = mp.eye(4), [(1, 2), (2, 0), (0, 1)][axis]
    out[i, i] = out[j, j] = mp.cos(angle)
    out[i, j], out[j, i] = -mp.sin(angle), mp.sin(angle)
    return out


def _shift(axis: int, length: mp.mpf) -> mp.matrix:
    out = mp.eye(4)
    out[axis, 3] = length
    return out
