"""A robot with joint terms in NumPy: own link matrices, own moments; complex, so that complex steps are derivatives.

Knows neither CasADi nor the package's kinematics; reads a term's kind, joint and numbers as the robot file says them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import expm
from strategies import random_frame, random_robot

from symcal.joints import Term
from symcal.joints.arm import Mass, Payload
from symcal.joints.backlash import Backlash
from symcal.joints.compliance import Compliance
from symcal.joints.coupling import Coupling
from symcal.joints.gravity import Gravity
from symcal.joints.harmonics import Harmonics
from symcal.joints.payload import PayloadTerm
from symcal.joints.ratio import Ratio
from symcal.robot.robot import Convention, Robot

Complex = np.ndarray
SIZES = {"rad": 0.02, "mm": 5.0, "1": 0.02, "rad/mm": 2e-5, "mm/rad": 2.0, "rad/Nmm": 2e-7, "mm/N": 0.02}
"""Sizes of numbers, of every unit, by which a joint moves by some hundredths of a radian or some mm."""
FLOOR, CEILING, WALL, SKEW = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.36, -0.48, 0.8)
MOUNTS = (FLOOR, CEILING, WALL, SKEW)


def turn(axis: int, angle: complex) -> Complex:
    matrix = np.eye(4, dtype=complex)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i], matrix[i, j] = np.sin(angle), -np.sin(angle)
    return matrix


def shift(x: complex = 0, y: complex = 0, z: complex = 0) -> Complex:
    matrix = np.eye(4, dtype=complex)
    matrix[:3, 3] = x, y, z
    return matrix


def increment(x: Mapping[str, complex], frame: str) -> Complex:
    rx, ry, rz = (x.get(f"{frame}_r{axis}", 0) for axis in "xyz")
    matrix = shift(*(x.get(f"{frame}_{axis}", 0) for axis in "xyz"))
    matrix[:3, :3] = expm(np.array([[0, -rz, ry], [rz, 0, -rx], [-ry, rx, 0]], dtype=complex))
    return matrix


def frames(robot: Robot, u: Complex, x: Mapping[str, complex]) -> tuple[list[Complex], list[Complex]]:
    """Of every joint after its motion, and of every link, in the base frame; u: coordinates, shape (dof,)."""
    pose, joints, links = np.eye(4, dtype=complex), [], []
    for i, link in enumerate(robot.links, start=1):
        theta, alpha, a, d, beta = (
            link.parameters.get(kind, 0.0) + x.get(f"{kind}_{i}", 0) for kind in ("theta", "alpha", "a", "d", "beta")
        )
        own = turn(2, theta + u[i - 1]) @ shift(z=d) if link.joint.revolute else turn(2, theta) @ shift(z=d + u[i - 1])
        if robot.convention == "standard":
            joints.append(pose @ own)
            pose = pose @ own @ shift(x=a) @ turn(0, alpha) @ turn(1, beta)
        else:
            pose = pose @ turn(0, alpha) @ shift(x=a) @ turn(1, beta) @ own
            joints.append(pose)
        links.append(pose)
    return joints, links


def coordinates(
    robot: Robot, q: Sequence[complex], x: Mapping[str, complex], conditions: Mapping[str, complex]
) -> Complex:
    """u_i = sign ratio q + offset + what the terms add, shape (dof,)."""
    given = [(j.sign * j.ratio, j.offset) for j in robot.joints]
    bare = np.array([rate * v + offset for v, (rate, offset) in zip(q, given, strict=True)], dtype=complex)
    joints, links = frames(robot, bare, x)
    carriers = [*joints, links[-1]]
    down = np.array(robot.down)

    def pull(i: int, point: Complex) -> complex:
        """What a unit weight at a point does at joint i: its moment about the axis, or the force along it."""
        axis, origin = carriers[i - 1][:3, 2], carriers[i - 1][:3, 3]
        return np.sum(axis * (np.cross(point - origin, down) if robot.joints[i - 1].revolute else down))

    def at(on: int, place: Sequence[float]) -> Complex:
        return (carriers[on - 1] @ np.array([*place, 1.0]))[:3]

    u = bare.copy()
    for term in robot.terms:
        j, flange = term.joint, robot.dof + 1
        value = {label: term.values.get(label, 0.0) + x.get(f"q{j}_{label}", 0) for label in term.labels}
        lever = 300.0 if term.revolute else 1.0
        if term.kind == "ratio":
            u[j - 1] += value["ratio"] * (bare[j - 1] - given[j - 1][1])
        elif term.kind == "coupling":
            u[j - 1] += value[f"by_q{term.by}"] * (bare[term.by - 1] - given[term.by - 1][1])
        elif term.kind == "backlash":
            u[j - 1] -= value["backlash"] * conditions.get(f"q{j}_direction", 0)
        elif term.kind == "harmonics":
            of = "" if term.gear is None else "motor_"
            angle = q[j - 1] * (term.gear or 1) if term.pitch is None else 2 * np.pi * q[j - 1] / term.pitch
            for k in term.k:
                u[j - 1] += value[f"{of}sin_{k}"] * np.sin(k * angle) + value[f"{of}cos_{k}"] * np.cos(k * angle)
        elif term.kind == "payload":
            u[j - 1] += value["payload"] * conditions.get("payload", 0) * pull(j, at(flange, robot.payload.at)) / lever
        elif term.kind == "gravity":
            for point in term.points:
                own = {"x": (j, (300.0, 0, 0)), "y": (j, (0, 300.0, 0)), "flange": (flange, (0, 0, 0))}
                on, place = own[point] if point in own else (int(point[1:]), (0, 0, 0))
                u[j - 1] += value[f"gravity_{point}"] * pull(j, at(on, place)) / lever
        else:
            carried = [(m.kg, at(m.on, m.at)) for m in robot.masses if m.on >= j]
            carried.append((robot.payload.kg + conditions.get("payload", 0), at(flange, robot.payload.at)))
            u[j - 1] += value["compliance"] * sum(9.80665 * kg * pull(j, point) for kg, point in carried)
    return u


def poses(
    robot: Robot,
    q: Sequence[complex],
    x: Mapping[str, complex] | None = None,
    conditions: Mapping[str, complex] | None = None,
) -> dict[str, Complex]:
    """T_world of base, of every link by its joint's name, flange and tool."""
    x = x or {}
    base = robot.base.astype(complex) @ increment(x, "base")
    _, links = frames(robot, coordinates(robot, q, x, conditions or {}), x)
    found = {joint.name: base @ link for joint, link in zip(robot.joints, links, strict=True)}
    tool = base @ links[-1] @ robot.tool @ increment(x, "tool")
    return found | {"base": base, "flange": base @ links[-1], "tool": tool}


def random_terms(rng: np.random.Generator, robot: Robot, share: float = 0.5) -> tuple[Term, ...]:
    """Of every kind at random joints, with numbers."""
    n, found = robot.dof, list[Term]()
    for j, joint in enumerate(robot.joints, start=1):
        turns = joint.revolute
        pitch = None if turns else float(rng.uniform(5, 50))
        kinds: list[Term] = [
            Ratio(j, turns),
            Harmonics(j, turns, k=tuple(rng.permutation(4)[: rng.integers(1, 4)] + 1), pitch=pitch),
            Backlash(j, turns),
            Compliance(j, turns),
            PayloadTerm(j, turns),
        ]
        kinds += [Coupling(j, turns, by=i, by_revolute=robot.joints[i - 1].revolute) for i in range(1, n + 1) if i != j]
        if turns:
            kinds.append(Harmonics(j, turns, k=(1, 2), gear=float(rng.uniform(3, 120))))
        points = [*(("x", "y") if turns else ("x",)), *(f"q{i}" for i in range(j + 1, n + 1)), "flange"]
        kinds.append(Gravity(j, turns, points=tuple(rng.permutation(points)[: rng.integers(1, len(points) + 1)])))
        found += [replace(t, k=tuple(map(int, t.k))) if isinstance(t, Harmonics) else t for t in kinds]
    kept = [term for term in found if rng.random() < share]
    return tuple(
        replace(term, values={m.label: float(rng.normal() * SIZES[m.unit]) for m in term.numbers}) for term in kept
    )


def random_arm(rng: np.random.Generator, convention: Convention | None = None, share: float = 0.5) -> Robot:
    """A robot of any joints with terms, masses, a payload and any direction of gravity."""
    robot = random_robot(rng, convention, int(rng.integers(1, 6)))
    masses = tuple(
        Mass(int(rng.integers(1, robot.dof + 2)), float(rng.uniform(0.5, 5)), tuple(rng.uniform(-200, 200, 3).tolist()))
        for _ in range(rng.integers(0, 4))
    )
    return replace(
        robot,
        base=random_frame(rng),
        terms=random_terms(rng, robot, share),
        down=MOUNTS[int(rng.integers(len(MOUNTS)))],
        masses=masses,
        payload=Payload(float(rng.uniform(0.5, 3)), tuple(rng.uniform(-100, 100, 3).tolist())),
        record=None,
        scales={},
    )


def random_conditions(rng: np.random.Generator, robot: Robot) -> dict[str, float]:
    return {n: float(rng.uniform(-1, 3)) if n == "payload" else float(rng.integers(-1, 2)) for n in robot.conditions}
