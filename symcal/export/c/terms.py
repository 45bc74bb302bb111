"""What joint terms add to a joint and its slopes by the readings, written a second time with numbers alone.

Part of the oracle of the exported self-test (`symcal.export.c.vectors`): it shares nothing with `symcal.joints` but the
numbers of the robot. Conditions are nominal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.joints import Term
from symcal.joints.arm import G
from symcal.joints.compliance import Compliance
from symcal.joints.coupling import Coupling
from symcal.joints.gravity import Gravity
from symcal.joints.harmonics import Harmonics
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

_LEVER = 300.0  # mm


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """The arm at readings (dof,) without its terms.

    frames: of the joints after their motion, and of the flange, in base, shape (dof + 1, 4, 4), mm. rates: of the
    joints by readings, shape (dof,).
    """

    robot: Robot
    q: Array
    frames: Sequence[Array]
    rates: Array

    def point(self, on: int, at: Sequence[float]) -> Array:
        """A point of the frame of a joint, from one, in base."""
        frame = self.frames[on - 1]
        return np.asarray(frame[:3, :3] @ np.asarray(at) + frame[:3, 3])

    def lever(self, joint: int, on: int, at: Sequence[float]) -> tuple[float, Array]:
        """Moment of a unit weight at a point about a joint, its share along a prismatic one; slopes by readings."""
        down, p = np.array(self.robot.down), self.point(on, at)
        axis, origin = self.frames[joint - 1][:3, 2], self.frames[joint - 1][:3, 3]
        revolute = self.robot.joints[joint - 1].revolute
        value = float(axis @ np.cross(p - origin, down)) if revolute else float(axis @ down)
        slopes = np.zeros(self.robot.dof)
        for j in range(1, self.robot.dof + 1):
            d_axis, d_origin = self._velocity(j, joint, origin)
            _, d_point = self._velocity(j, on, p)
            if revolute:
                change = d_axis @ np.cross(p - origin, down) + axis @ np.cross(d_point - d_origin, down)
            else:
                change = d_axis @ down
            slopes[j - 1] = self.rates[j - 1] * change
        return value, slopes

    def _velocity(self, j: int, on: int, p: Array) -> tuple[Array, Array]:
        """How joint j moves the z axis of a frame that joint ``on`` carries, and a point of it."""
        frame, still = self.frames[j - 1], np.zeros(3)
        if j > on:
            return still, still
        if not self.robot.joints[j - 1].revolute:
            return still, frame[:3, 2]
        carried = self.frames[on - 1][:3, 2]
        return np.cross(frame[:3, 2], carried), np.cross(frame[:3, 2], p - frame[:3, 3])


def added(at: Posture) -> tuple[Array, Array]:
    """delta, shape (dof,), and its slopes by readings, shape (dof, dof); rad and mm."""
    delta, slopes = np.zeros(at.robot.dof), np.zeros((at.robot.dof, at.robot.dof))
    for term in at.robot.terms:
        if term.kind not in _ADDED:
            raise RefusedError(f"the self-test of exported C knows no joint terms of kind '{term.kind}'")
        value, slope = _ADDED[term.kind](term, at)
        delta[term.joint - 1] += value
        slopes[term.joint - 1] += slope
    return delta, slopes


def slope_rounding(robot: Robot) -> float:
    """By how much rounding of a fast wave's argument spoils a slope of a joint, per unit of the precision's epsilon.

    sin(n q) with n turns per turn: the argument is off by n q epsilon, the slope a n cos(n q) by a n times that.
    """
    largest = np.abs(np.array(robot.ranges)).max(axis=0)
    total = 0.0
    for term in robot.terms:
        if isinstance(term, Harmonics):
            turns = (term.gear or 1.0) * (2 * np.pi / term.pitch if term.pitch else 1.0)
            sizes = {k: sum(abs(v) for label, v in term.values.items() if label.endswith(f"_{k}")) for k in term.k}
            total += sum(a * (k * turns) ** 2 * largest[term.joint - 1] for k, a in sizes.items())
    return float(total)


def _nothing(_: Term, at: Posture) -> tuple[float, Array]:
    return 0.0, np.zeros(at.robot.dof)


def _along(at: Posture, joint: int, factor: float) -> tuple[float, Array]:
    """A joint's motion times a factor."""
    rate = factor * at.rates[joint - 1]
    return float(rate * at.q[joint - 1]), rate * np.eye(at.robot.dof)[joint - 1]


def _ratio(term: Term, at: Posture) -> tuple[float, Array]:
    return _along(at, term.joint, term.values.get("ratio", 0.0))


def _coupling(term: Term, at: Posture) -> tuple[float, Array]:
    assert isinstance(term, Coupling)
    return _along(at, term.by, term.values.get(f"by_q{term.by}", 0.0))


def _harmonics(term: Term, at: Posture) -> tuple[float, Array]:
    assert isinstance(term, Harmonics)
    of = "motor_" if term.gear is not None else ""
    turns = (1.0 if term.gear is None else term.gear) * (1.0 if term.pitch is None else 2 * np.pi / term.pitch)
    wave = sum(
        complex(term.values.get(f"{of}cos_{k}", 0.0), -term.values.get(f"{of}sin_{k}", 0.0))
        * np.exp(1j * k * turns * at.q[term.joint - 1])
        * np.array([1.0, 1j * k * turns])
        for k in term.k
    )
    value, slope = np.real(wave)
    return float(value), slope * np.eye(at.robot.dof)[term.joint - 1]


def _weights(at: Posture, joint: int, weights: Sequence[tuple[float, int, Sequence[float]]]) -> tuple[float, Array]:
    value, slopes = 0.0, np.zeros(at.robot.dof)
    for weight, on, place in weights:
        lever, slope = at.lever(joint, on, place)
        value, slopes = value + weight * lever, slopes + weight * slope
    return value, slopes


def _gravity(term: Term, at: Posture) -> tuple[float, Array]:
    assert isinstance(term, Gravity)
    arm = _LEVER if term.revolute else 1.0
    places: dict[str, tuple[int, Sequence[float]]] = {
        "x": (term.joint, (_LEVER, 0.0, 0.0)),
        "y": (term.joint, (0.0, _LEVER, 0.0)),
        "flange": (at.robot.dof + 1, (0.0, 0.0, 0.0)),
    }
    weights = [
        (term.values.get(f"gravity_{p}", 0.0) / arm, *(places[p] if p in places else (int(p[1:]), (0.0, 0.0, 0.0))))
        for p in term.points
    ]
    return _weights(at, term.joint, weights)


def _compliance(term: Term, at: Posture) -> tuple[float, Array]:
    assert isinstance(term, Compliance)
    soft, payload = G * term.values.get("compliance", 0.0), at.robot.payload
    weights = [(soft * mass.kg, mass.on, mass.at) for mass in at.robot.masses if mass.on >= term.joint]
    return _weights(at, term.joint, [*weights, (soft * payload.kg, at.robot.dof + 1, payload.at)])


_ADDED: dict[str, Callable[[Term, Posture], tuple[float, Array]]] = {
    "ratio": _ratio,
    "harmonics": _harmonics,
    "coupling": _coupling,
    "gravity": _gravity,
    "compliance": _compliance,
    "backlash": _nothing,
    "payload": _nothing,
}
