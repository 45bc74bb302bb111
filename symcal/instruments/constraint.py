r"""Constraints: nothing is read, but a point of the robot must lie on a thing of the workshop. A ball in a socket
(`fixed_point`) or on a flat plate (`plane`); their residual is their reading, z = 0.

    fixed_point:  r = p,        plane:  r = n . p - radius,   n the z axis of its place, out of the plate

Their noise moves the place: the posture gives way until the point lies where the ball really is. So the residual is
not independent of the joint readings, and least squares would shrink the arm to have less of it: for a growth g of all
lengths |r|^2 changes as g^2, with no measurement against it. What is minimised is therefore |r / g|^2 (ours; see
`symcal.model.observe`), which leaves uniform growth exactly unseen, as it is. Calibration by closed loops:
[Hollerbach1996].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import casadi as ca
import numpy as np
from pydantic import Field

from symcal.instruments.protocol import Column, Edge, Instrument, Keys, Margin, Quantity, sigmas

SX = ca.SX


class FixedPointKeys(Keys):
    """tilt: largest angle between the target's z axis and the way into the socket (-z of its place); any when left
    out."""

    tilt: Annotated[float, Field(gt=0)] | None = None


class PlaneKeys(FixedPointKeys):
    """radius: of the ball that touches, in the file's unit of length; of the target's point itself when 0."""

    radius: Annotated[float, Field(ge=0)] = 0.0


@dataclass(frozen=True, slots=True)
class Constraint(Instrument):
    """What a point of the robot touches. tilt: largest angle of the target's z axis to -z of its place, rad."""

    constrains: ClassVar[bool] = True
    sees_length: ClassVar[bool] = False
    tilt: float | None = None

    @property
    def limits(self) -> tuple[Margin, ...]:
        return () if self.tilt is None else (Margin("upright enough to touch", "rad", 0.1),)

    def margins(self, rotation: SX, point: SX, own: SX) -> SX:
        if self.tilt is None:
            return SX(0, 1)
        return SX(self.tilt) - ca.acos(ca.fmin(ca.fmax(-rotation[2, 2], -1), 1))


@dataclass(frozen=True, slots=True)
class FixedPoint(Constraint):
    """A ball in a socket, a tip on a pin.

    Example:
        >>> import symcal as sc
        >>> sc.FixedPoint(tilt=1.0).constrains
        True
    """

    name: ClassVar[str] = "fixed_point"
    label: ClassVar[str] = "contacts with a fixed point"
    error_words: ClassVar[str] = "distance from the fixed point"
    Config: ClassVar[type[Keys]] = FixedPointKeys
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("position", "mm", 3, 1e-9, sigmas("x", "y", "z"), "sigma"),)
    columns: ClassVar[tuple[Column, ...]] = (("x", "mm"), ("y", "mm"), ("z", "mm"))
    sees: ClassVar[tuple[str, ...]] = ("x", "y", "z")

    @classmethod
    def configured(cls, keys: Any, edge: Edge) -> Self:
        return cls(tilt=_tilt(keys, edge))

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return point

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        return ca.horzcat(SX(3, 3), SX.eye(3)), SX(3, 0)


@dataclass(frozen=True, slots=True)
class Plane(Constraint):
    """A flat plate that is touched. radius: of the ball, mm.

    Example:
        >>> import symcal as sc
        >>> sc.Plane(radius=10.0).sees
        ('z', 'rx', 'ry')
    """

    name: ClassVar[str] = "plane"
    label: ClassVar[str] = "contacts with a plane"
    error_words: ClassVar[str] = "distance from the plane"
    Config: ClassVar[type[Keys]] = PlaneKeys
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("height", "mm", 1, 1e-9, sigmas("height"), "sigma"),)
    columns: ClassVar[tuple[Column, ...]] = (("height", "mm"),)
    sees: ClassVar[tuple[str, ...]] = ("z", "rx", "ry")
    radius: float = 0.0

    @classmethod
    def configured(cls, keys: Any, edge: Edge) -> Self:
        return cls(radius=keys.radius * edge.length, tilt=_tilt(keys, edge))

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return point[2] - self.radius

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        return SX(np.eye(6)[5:]), SX(1, 0)


def _tilt(keys: FixedPointKeys, edge: Edge) -> float | None:
    return None if keys.tilt is None else keys.tilt * edge.angle
