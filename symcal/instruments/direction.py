"""Directions of the target's axes: a beam, a spindle, a tracker of rotations alone.

    h = u = R e_z,        r = angle / sin(angle) E^T u (rad),        E: two unit vectors across the measured direction

with R the feature's axes, of which z is the one that is read: the angle between the two by its parts across the
measured direction (the logarithm of the sphere), so that the opposite direction is as wrong as can be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from symcal.instruments.protocol import Array, Column, Draw, Instrument, Quantity, sigmas

SX = ca.SX


@dataclass(frozen=True, slots=True)
class Direction(Instrument):
    """Directions of the target's axes.

    Example:
        >>> import symcal as sc
        >>> sc.Direction().sees
        ('rx', 'ry', 'rz')
    """

    name: ClassVar[str] = "direction"
    label: ClassVar[str] = "directions"
    reads: ClassVar[Literal["points", "axes", "frame"]] = "axes"
    makes_world: ClassVar[bool] = True
    error_words: ClassVar[str] = "angle between the directions"
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("direction", "rad", 2, 1e-12, sigmas("across_1", "across_2"), "sigma"),
    )
    sees_length: ClassVar[bool] = False
    columns: ClassVar[tuple[Column, ...]] = (("ux", None), ("uy", None), ("uz", None))
    sees: ClassVar[tuple[str, ...]] = ("rx", "ry", "rz")

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return rotation[:, 2]

    def residual(self, rotation: SX, point: SX, reading: SX, own: SX) -> SX:
        measured = reading / ca.norm_2(reading)
        across = _across(measured).T @ rotation[:, 2]
        return _per_sine(ca.sumsqr(across), ca.dot(measured, rotation[:, 2])) * across

    def retract(self, reading: Array, noise: Mapping[str, Draw]) -> Array:
        flat = reading.reshape(-1, 3)
        # two parts of noise across each direction, in any orthonormal pair
        pair = np.linalg.svd(flat[:, None, :])[2][:, 1:]
        moved = flat + np.einsum("ni,nij->nj", noise["direction"]((len(flat), 2)), pair)
        return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True)).reshape(reading.shape)


def _per_sine(sine2: SX, cosine: SX) -> SX:
    """angle / sin(angle); its series where the angle is small."""
    small = ca.logic_and(sine2 < 1e-4, cosine > 0)
    sine = ca.sqrt(ca.if_else(small, 1.0, ca.fmax(sine2, 1e-30)))
    series = 1 + sine2 / 6 * (1 + 9 * sine2 / 20 * (1 + 25 * sine2 / 42))
    return ca.if_else(small, series, ca.atan2(sine, cosine) / sine)


def _across(u: SX) -> SX:
    """Two unit vectors across a unit vector, shape (3, 2), without a singular direction in reach.

    Source: [Duff2017], the branch by the sign of z.
    """
    sign = ca.if_else(u[2] >= 0, 1.0, -1.0)
    a = -1 / (sign + u[2])
    b = u[0] * u[1] * a
    first = ca.vertcat(1 + sign * u[0] ** 2 * a, sign * b, -sign * u[0])
    return ca.horzcat(first, ca.vertcat(b, sign + u[1] ** 2 * a, -u[1]))
