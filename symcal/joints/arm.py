"""What joint terms may ask: readings, conditions of a pose, and where the links are; in the base frame, mm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca

SX = ca.SX

G = 9.80665
"""Newton per kg ([CGPM1901])."""


@dataclass(frozen=True, slots=True)
class Mass:
    """A mass that moves with a joint.

    on: the joint, from one; dof + 1 is the flange. kg: mass. at: its centre, mm, in the frame of the joint (z along the
    axis, turned and shifted with it: the same in both link conventions) or of the flange.
    """

    on: int
    kg: float
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Payload:
    """What the flange carries: kg, and its centre in the flange frame, mm."""

    kg: float = 0.0
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Arm:
    """The arm as it would stand without its terms.

    q: readings, shape (dof,). moved: what the readings move the joints by, sign * ratio * q, shape (dof,).
    revolute: by joint. frames: of the joints (after their own motion) and of the flange, rotation (3, 3) and origin
    (3,), in base, mm; empty where no term asks. down: direction of gravity in base, of length one. conditions: what
    poses say beside readings, by name; zero is nominal: `q2_direction` (-1, 0, 1), `payload` (kg more than nominal).
    """

    q: SX
    moved: SX
    revolute: tuple[bool, ...]
    frames: tuple[tuple[SX, SX], ...] = ()
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)
    conditions: Mapping[str, SX] = field(default_factory=dict)
    masses: tuple[Mass, ...] = ()
    payload: Payload = field(default_factory=Payload)

    def place(self, on: int, at: tuple[float, float, float]) -> SX:
        """A point of the frame of a joint (dof + 1: of the flange) in base, shape (3,), mm."""
        rotation, origin = self.frames[on - 1]
        out = origin
        for axis, value in enumerate(at):
            if value != 0:
                out = out + value * rotation[:, axis]
        return out

    def lever(self, joint: int, point: SX) -> SX:
        """Moment of a unit weight at a point about the axis of a revolute joint, mm: z . ((p - o) x g); along a
        prismatic one the share of the weight, z . g."""
        rotation, origin = self.frames[joint - 1]
        axis, down = rotation[:, 2], SX(ca.DM(self.down))
        if not self.revolute[joint - 1]:
            return ca.dot(axis, down)
        return ca.dot(ca.cross(down, axis), point - origin)
