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


def _tilt(tilt: float | None) -> tuple[Margin, ...]:
    return () if tilt is None else (Margin("upright enough to touch", "rad", 0.1),)


def _upright(tilt: float | None, rotation: SX) -> SX:
    """By how much the target's z axis is nearer to the way in than the largest angle, shape (1,) or (0,)."""
    return SX(0, 1) if tilt is None else SX(tilt) - ca.acos(ca.fmin(ca.fmax(-rotation[2, 2], -1), 1))


@dataclass(frozen=True, slots=True)
class FixedPoint(Instrument):
    """A ball in a socket, a tip on a pin. tilt: largest angle of the target's z axis to -z of its place, rad."""

    name: ClassVar[str] = "fixed_point"
    label: ClassVar[str] = "contacts with a fixed point"
    error_words: ClassVar[str] = "distance from the fixed point"
    constrains: ClassVar[bool] = True
    sees_length: ClassVar[bool] = False
    Config: ClassVar[type[Keys]] = FixedPointKeys
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("position", "mm", 3, 1e-9, sigmas("x", "y", "z"), "sigma"),)
    columns: ClassVar[tuple[Column, ...]] = (("x", "mm"), ("y", "mm"), ("z", "mm"))
    sees: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    tilt: float | None = None

    @classmethod
    def configured(cls, keys: Any, edge: Edge) -> Self:
        return cls(None if keys.tilt is None else keys.tilt * edge.angle)

    @property
    def limits(self) -> tuple[Margin, ...]:
        return _tilt(self.tilt)

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return point

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        return ca.horzcat(SX(3, 3), SX.eye(3)), SX(3, 0)

    def margins(self, rotation: SX, point: SX, own: SX) -> SX:
        return _upright(self.tilt, rotation)


@dataclass(frozen=True, slots=True)
class Plane(Instrument):
    """A flat plate that is touched. radius: of the ball, mm. tilt: as that of `FixedPoint`."""

    name: ClassVar[str] = "plane"
    label: ClassVar[str] = "contacts with a plane"
    error_words: ClassVar[str] = "distance from the plane"
    constrains: ClassVar[bool] = True
    sees_length: ClassVar[bool] = False
    Config: ClassVar[type[Keys]] = PlaneKeys
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("height", "mm", 1, 1e-9, sigmas("height"), "sigma"),)
    columns: ClassVar[tuple[Column, ...]] = (("height", "mm"),)
    sees: ClassVar[tuple[str, ...]] = ("z", "rx", "ry")
    radius: float = 0.0
    tilt: float | None = None

    @classmethod
    def configured(cls, keys: Any, edge: Edge) -> Self:
        return cls(keys.radius * edge.length, None if keys.tilt is None else keys.tilt * edge.angle)

    @property
    def limits(self) -> tuple[Margin, ...]:
        return _tilt(self.tilt)

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return point[2] - self.radius

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        return SX(np.eye(6)[5:]), SX(1, 0)

    def margins(self, rotation: SX, point: SX, own: SX) -> SX:
        return _upright(self.tilt, rotation)
