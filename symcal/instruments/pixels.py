r"""Image points of a target, as a camera sees them.

    (u, v) = project(p)

with p in the camera's frame, z along the view. With P = d(u, v)/dp, shape (2, 3), a twist (omega, v) of the point moves
its image by P v; the camera's numbers enter (u, v) directly. Conventions are those of `symcal.camera.camera`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import casadi as ca
import numpy as np

from symcal.camera.camera import INTRINSIC_NAMES, NUMBER_NAMES, Camera, distort, distortion_slopes
from symcal.camera.files import camera_from_dict, camera_to_dict, read_camera
from symcal.instruments.protocol import Array, Column, Edge, Instrument, Keys, Margin, Quantity
from symcal.parameters import JointPrior, Parameter, Unit

SX = ca.SX

_FOCAL = 0.01  # plausible error of focal length and principal point, as a share of focal length and image width
_DISTORTION = 0.1  # of a distortion coefficient
_PRIOR_SIGMAS = 10.0  # a joint prior determines what it is about: scales of at least so many of its sigmas
_ANY = Camera(1000, 1000, 1000.0, 1000.0, 500.0, 500.0)


class PixelKeys(Keys):
    """camera: a camera.yaml. intrinsics: `unknown` finds them, with their calibration's covariance as prior."""

    camera: str
    intrinsics: Literal["known", "unknown"] = "unknown"


@dataclass(frozen=True, slots=True, eq=False)
class Pixels(Instrument):
    """Image points of a target.

    camera: its optics; calibrate: whether the intrinsics are to be found too.

    Example:
        >>> import symcal as sc
        >>> eye = sc.Pixels(sc.read_camera("configs/vision/camera_data_sheet.yaml"))
        >>> eye.columns
        (('u', 'px'), ('v', 'px'))
    """

    name: ClassVar[str] = "pixels"
    label: ClassVar[str] = "image points"
    error_words: ClassVar[str] = "error across the lines of sight"
    limits: ClassVar[tuple[Margin, ...]] = (
        Margin("in front of the camera", "mm", 100.0),
        Margin("in the camera's image", "px", 100.0),
    )
    is_camera: ClassVar[bool] = True
    Config: ClassVar[type[Keys]] = PixelKeys
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("image", "px", 2, 1e-9, ("sigma_u", "sigma_v"), "sigma"),)
    columns: ClassVar[tuple[Column, ...]] = (("u", "px"), ("v", "px"))
    error: ClassVar[tuple[str, Unit, int]] = ("position", "mm", 3)
    componentwise: ClassVar[bool] = False
    camera: Camera = field(default=_ANY)
    calibrate: bool = True

    @classmethod
    def configured(cls, keys: Any, edge: Edge) -> Self:
        return cls(read_camera(edge.path(keys.camera, "camera")), keys.intrinsics == "unknown")

    @property
    def own(self) -> tuple[str, ...]:  # type: ignore[override]  # those of the camera at hand
        return NUMBER_NAMES if self.camera.has_skew else INTRINSIC_NAMES

    @property
    def numbers(self) -> Array:
        return self.camera.numbers if self.camera.has_skew else self.camera.intrinsics

    def unknowns(self, prefix: str) -> tuple[Sequence[Parameter], Sequence[JointPrior]]:
        """The covariance of the calibration is their prior, and what it held is no parameter; without one all nine are
        (and the skew, if the camera has one), without a prior."""
        if not self.calibrate:
            return (), ()
        covariance = self.camera.covariance
        variance = np.ones(len(self.own)) if covariance is None else np.diag(covariance)
        free = np.flatnonzero(variance > 0)
        items = []
        sizes = {"fx": self.camera.fx, "fy": self.camera.fy, "cx": self.camera.width, "cy": self.camera.width}
        sizes["skew"] = self.camera.fx
        for i in free:
            name = NUMBER_NAMES[i]
            unit: Unit = "px" if name in sizes else "1"
            size = _FOCAL * sizes[name] if name in sizes else _DISTORTION
            scale = size if covariance is None else max(size, _PRIOR_SIGMAS * float(np.sqrt(variance[i])))
            nominal = float(self.camera.numbers[i])
            items.append(Parameter(f"{prefix}{name}", unit, nominal, scale, unknown=True))
        if covariance is None or not free.size:
            return items, ()
        return items, (JointPrior(tuple(p.name for p in items), covariance[np.ix_(free, free)]),)

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return _project(point, own)[1]

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        by_point, _, by_own = _project(point, own)
        return ca.horzcat(SX(2, 3), by_point), by_own

    def margins(self, rotation: SX, point: SX, own: SX) -> SX:
        """Depth, and the distance from the image's border; as far outside as can be where nothing is projected."""
        size, (u, v) = (self.camera.width, self.camera.height), ca.vertsplit(_project(point, own)[1])
        inside = ca.fmin(ca.fmin(u + 0.5, size[0] - 0.5 - u), ca.fmin(v + 0.5, size[1] - 0.5 - v))
        return ca.vertcat(point[2], ca.if_else(point[2] > 0, ca.fmax(inside, -sum(size)), -sum(size)))

    def miss(self, rotation: SX, point: SX, reading: SX, own: SX, *, riding: bool) -> tuple[SX, SX]:
        """The smallest displacement, across the line of sight, that would explain the residual."""
        by_point, image, _ = _project(point, own)
        return by_point.T @ ca.inv(by_point @ by_point.T) @ (image - reading), SX(0, 1)

    def record(self) -> dict[str, Any]:
        return {"camera": camera_to_dict(replace(self.camera, covariance=None, rms_px=None))}

    @classmethod
    def recalled(cls, settings: Mapping[str, Any], file: Path) -> Self:
        return cls(camera_from_dict(settings["camera"], file), calibrate=False)

    def corrected(self, errors: Mapping[str, float]) -> Self:
        step = np.array([errors.get(name, 0.0) for name in NUMBER_NAMES])
        return replace(self, camera=self.camera.with_numbers(self.camera.numbers + step))


def _project(point: SX, intrinsics: SX) -> tuple[SX, SX, SX]:
    """Derivative of the image point by the point in the camera frame (2, 3), the image point, and its derivative by
    the numbers of the camera: nine, and the skew if it has one."""
    fx, fy, cx, cy, *dist = ca.vertsplit(intrinsics[:9])
    skew = intrinsics[9] if intrinsics.numel() > len(INTRINSIC_NAMES) else SX(0)
    x, y, depth = point[0] / point[2], point[1] / point[2], point[2]
    xd, yd = distort(x, y, dist)
    (xx, yx), (xy, yy) = distortion_slopes(x, y, dist)
    of_x, of_y = ca.horzcat(xx, xy, -(xx * x + xy * y)) / depth, ca.horzcat(yx, yy, -(yx * x + yy * y)) / depth
    by_point = ca.vertcat(fx * of_x + skew * of_y, fy * of_y)
    r2 = x * x + y * y
    radial = [r2, r2**2, r2**3]
    of_xd = ca.horzcat(x * radial[0], x * radial[1], 2 * x * y, r2 + 2 * x * x, x * radial[2])
    of_yd = ca.horzcat(y * radial[0], y * radial[1], r2 + 2 * y * y, 2 * x * y, y * radial[2])
    by_numbers = ca.vertcat(
        ca.horzcat(xd, 0, 1, 0, fx * of_xd + skew * of_yd, yd), ca.horzcat(0, yd, 0, 1, fy * of_yd, 0)
    )
    return by_point, ca.vertcat(fx * xd + skew * yd + cx, fy * yd + cy), by_numbers[:, : intrinsics.numel()]
