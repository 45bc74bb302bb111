r"""Image points of a target, as a camera sees them.

    (u, v) = project(p)

with p in the camera's frame, z along the view. With P = d(u, v)/dp, shape (2, 3), a twist (omega, v) of the point moves
its image by P v; the camera's numbers enter (u, v) directly. Conventions are those of `symcal.camera.camera`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from symcal.camera.camera import INTRINSIC_NAMES, distort, distortion_slopes
from symcal.instruments.protocol import Array, Draw, Quantity, Unit
from symcal.parameters import frame_names

SX = ca.SX


@dataclass(frozen=True, slots=True)
class Pixels:
    name: str = "pixels"
    quantities: tuple[Quantity, ...] = (Quantity("image", "px", 2, 1e-9, ("sigma_u", "sigma_v"), "sigma"),)
    columns: tuple[tuple[str, Unit | None], ...] = (("u", "px"), ("v", "px"))
    reads_points: bool = True
    gives_point: bool = False
    error_words: str = "error across the lines of sight"
    place: tuple[str, ...] = frame_names("camera")
    own: tuple[str, ...] = INTRINSIC_NAMES

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return _project(point, own)[1]

    def residual(self, rotation: SX, point: SX, reading: SX, own: SX) -> SX:
        return self.predict(rotation, point, own) - reading

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        by_point, _, by_own = _project(point, own)
        return ca.horzcat(SX(2, 3), by_point), by_own

    def error(self, rotation: SX, point: SX, reading: SX, own: SX, *, riding: bool) -> tuple[SX, SX]:
        """The smallest displacement, across the line of sight, that would explain the residual."""
        by_point, image, _ = _project(point, own)
        return by_point.T @ ca.inv(by_point @ by_point.T) @ (image - reading), SX(0, 1)

    def retract(self, reading: Array, noise: Mapping[str, Draw]) -> Array:
        return reading + noise["image"](reading.shape)


def _project(point: SX, intrinsics: SX) -> tuple[SX, SX, SX]:
    """Derivative of the image point by the point in the camera frame (2, 3), the image point, and its derivative by
    the nine intrinsics (2, 9)."""
    fx, fy, cx, cy, *dist = ca.vertsplit(intrinsics)
    x, y, depth = point[0] / point[2], point[1] / point[2], point[2]
    xd, yd = distort(x, y, dist)
    (xx, yx), (xy, yy) = distortion_slopes(x, y, dist)
    by_point = ca.vertcat(
        fx / depth * ca.horzcat(xx, xy, -(xx * x + xy * y)), fy / depth * ca.horzcat(yx, yy, -(yx * x + yy * y))
    )
    r2 = x * x + y * y
    radial = [r2, r2**2, r2**3]
    by_u = [xd, 0, 1, 0, fx * x * radial[0], fx * x * radial[1], 2 * fx * x * y, fx * (r2 + 2 * x * x)]
    by_v = [0, yd, 0, 1, fy * y * radial[0], fy * y * radial[1], fy * (r2 + 2 * y * y), 2 * fy * x * y]
    by_intrinsics = ca.vertcat(ca.horzcat(*by_u, fx * x * radial[2]), ca.horzcat(*by_v, fy * y * radial[2]))
    return by_point, ca.vertcat(fx * xd + cx, fy * yd + cy), by_intrinsics
