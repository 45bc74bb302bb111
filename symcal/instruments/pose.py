"""Pose of the target's frame: photogrammetry of a rigid body, a camera that reports poses.

    r_p = p - p_z (mm),        r_w = log(R_z^T R) (rad)

so the sign of a measured quaternion does not matter. Where the instrument rides on the tool the residual is taken on
what it reports, where its noise lives, and the tool's error on the inverse, which is what the user asks about.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.instruments.protocol import Array, Draw, Quantity, Unit

SX = ca.SX

_LEVER = 200.0  # mm: as far apart are the marks from which attitudes are commonly measured


@dataclass(frozen=True, slots=True)
class Pose:
    name: str = "pose"
    quantities: tuple[Quantity, ...] = (
        Quantity("position", "mm", 3, 1e-9, ("sigma_x", "sigma_y", "sigma_z"), "sigma"),
        Quantity("orientation", "rad", 3, 1e-12, ("sigma_rx", "sigma_ry", "sigma_rz"), "sigma_rot", 1 / _LEVER),
    )
    columns: tuple[tuple[str, Unit | None], ...] = (
        *((c, "mm") for c in "xyz"),
        *((c, None) for c in ("qx", "qy", "qz", "qw")),
    )
    reads_points: bool = False
    gives_point: bool = True
    error_words: str = "tool error"
    place: tuple[str, ...] = ()
    own: tuple[str, ...] = ()

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return ca.vertcat(point, _quaternion(rotation))

    def residual(self, rotation: SX, point: SX, reading: SX, own: SX) -> SX:
        turn = spatial.log_rotation(spatial.quaternion_matrix(reading[3:]).T @ rotation)
        return ca.vertcat(point - reading[:3], turn)

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        attitude = rotation.T
        if reading is not None:
            attitude = spatial.right_jacobian_inverse(self.residual(rotation, point, reading, own)[3:]) @ attitude
        upper, lower = ca.horzcat(SX(3, 3), SX.eye(3)), ca.horzcat(attitude, SX(3, 3))
        return ca.vertcat(upper, lower), SX(6, 0)

    def error(self, rotation: SX, point: SX, reading: SX, own: SX, *, riding: bool) -> tuple[SX, SX]:
        measured_r, measured_p = spatial.quaternion_matrix(reading[3:]), reading[:3]
        if riding:
            rotation, point = rotation.T, -(rotation.T @ point)
            measured_r, measured_p = measured_r.T, -(measured_r.T @ measured_p)
        return point - measured_p, spatial.log_rotation(measured_r.T @ rotation)

    def retract(self, reading: Array, noise: Mapping[str, Draw]) -> Array:
        flat = reading.reshape(-1, 7)
        position = flat[:, :3] + noise["position"]((len(flat), 3))
        turn = Rotation.from_rotvec(noise["orientation"]((len(flat), 3)))
        attitude = (Rotation.from_quat(flat[:, 3:]) * turn).as_quat(canonical=True)
        return np.hstack([position, attitude]).reshape(reading.shape)


def _quaternion(rotation: SX) -> SX:
    """Unit quaternion (x, y, z, w) of a rotation matrix, through its rotation vector; shape (4,)."""
    v = spatial.log_rotation(rotation)
    angle2 = ca.dot(v, v)
    small = angle2 < 1e-16
    angle = ca.sqrt(ca.if_else(small, 1.0, angle2))
    return ca.vertcat(ca.if_else(small, 0.5, ca.sin(angle / 2) / angle) * v, ca.if_else(small, 1.0, ca.cos(angle / 2)))
