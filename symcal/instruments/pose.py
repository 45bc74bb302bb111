"""Pose of the target's frame: photogrammetry of a rigid body, a camera that reports poses.

    r_p = p - p_z (mm),        r_w = log(R_z^T R) (rad)

so the sign of a measured quaternion does not matter. Where the instrument rides on the robot the residual is taken on
what it reports, where its noise lives, and the tool's error on the inverse, which is what the user asks about. Noise
by axis needs both parts in one frame: the observer's (r_w = log(R R_z^T)) or the observed one's (R_z^T (p - p_z)).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import casadi as ca
import numpy as np
import scipy

from symcal import spatial
from symcal.instruments.protocol import Array, Column, Draw, Instrument, Quantity, sigmas

SX = ca.SX

_LEVER = 200.0  # mm: as far apart are the marks from which attitudes are commonly measured


@dataclass(frozen=True, slots=True)
class Pose(Instrument):
    """Position and attitude of frames.

    axes: whose axes the components of the residual have; `reported` is position by the observer's, turn by the
    observed one's.

    Example:
        >>> import symcal as sc
        >>> [quantity.noise for quantity in sc.Pose().quantities]
        ['position', 'orientation']
    """

    name: ClassVar[str] = "pose"
    label: ClassVar[str] = "poses"
    reads: ClassVar[Literal["points", "axes", "frame"]] = "frame"
    gives_point: ClassVar[bool] = True
    makes_world: ClassVar[bool] = True
    error_words: ClassVar[str] = "tool error"
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("position", "mm", 3, 1e-9, sigmas(*"xyz"), "sigma"),
        Quantity("orientation", "rad", 3, 1e-12, sigmas("rx", "ry", "rz"), "sigma_rot", 1 / _LEVER),
    )
    columns: ClassVar[tuple[Column, ...]] = (
        *((c, "mm") for c in "xyz"),
        *((c, None) for c in ("qx", "qy", "qz", "qw")),
    )
    axes: Literal["reported", "observer", "observed"] = "reported"

    def by_axis(self, *, observed: bool) -> Self:
        return replace(self, axes="observed" if observed else "observer")

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return ca.vertcat(point, _quaternion(rotation))

    def residual(self, rotation: SX, point: SX, reading: SX, own: SX) -> SX:
        measured = spatial.quaternion_matrix(reading[3:])
        shift = point - reading[:3]
        if self.axes == "observed":
            shift = measured.T @ shift
        both = rotation @ measured.T if self.axes == "observer" else measured.T @ rotation
        return ca.vertcat(shift, spatial.log_rotation(both))

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        if self.axes != "reported":
            return Instrument.slopes(self, rotation, point, reading, own)
        attitude = rotation.T
        if reading is not None:
            attitude = spatial.right_jacobian_inverse(self.residual(rotation, point, reading, own)[3:]) @ attitude
        upper, lower = ca.horzcat(SX(3, 3), SX.eye(3)), ca.horzcat(attitude, SX(3, 3))
        return ca.vertcat(upper, lower), SX(6, 0)

    def miss(self, rotation: SX, point: SX, reading: SX, own: SX, *, riding: bool) -> tuple[SX, SX]:
        measured_r, measured_p = spatial.quaternion_matrix(reading[3:]), reading[:3]
        if riding:
            back = rotation
            rotation, point = rotation.T, -(rotation.T @ point)
            measured_r, measured_p = measured_r.T, -(measured_r.T @ measured_p)
            return back @ (point - measured_p), spatial.log_rotation(measured_r.T @ rotation)
        return point - measured_p, spatial.log_rotation(measured_r.T @ rotation)

    def retract(self, reading: Array, noise: Mapping[str, Draw]) -> Array:
        flat = reading.reshape(-1, 7)
        shift, turn = (
            noise["position"]((len(flat), 3)),
            scipy.spatial.transform.Rotation.from_rotvec(noise["orientation"]((len(flat), 3))),
        )
        measured = scipy.spatial.transform.Rotation.from_quat(flat[:, 3:])
        position = flat[:, :3] + (measured.apply(shift) if self.axes == "observed" else shift)
        attitude = (turn * measured if self.axes == "observer" else measured * turn).as_quat(canonical=True)
        return np.hstack([position, attitude]).reshape(reading.shape)


def _quaternion(rotation: SX) -> SX:
    """Unit quaternion (x, y, z, w) of a rotation matrix, through its rotation vector; shape (4,)."""
    v = spatial.log_rotation(rotation)
    angle2 = ca.dot(v, v)
    small = angle2 < 1e-16
    angle = ca.sqrt(ca.if_else(small, 1.0, angle2))
    return ca.vertcat(ca.if_else(small, 0.5, ca.sin(angle / 2) / angle) * v, ca.if_else(small, 1.0, ca.cos(angle / 2)))
