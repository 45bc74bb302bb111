"""camera.yaml and target.yaml: strict in, exact out."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from symcal import spatial
from symcal.camera.camera import INTRINSIC_NAMES, NUMBER_NAMES, Camera
from symcal.camera.target import Target
from symcal.documents.document import Document, Strict, read_document, validate, write_document
from symcal.errors import InputError
from symcal.robot.schema import Frame, RobotUnits
from symcal.units import ANGLE, LENGTH

_Positive = Annotated[float, Field(gt=0)]
_Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
_Row = Annotated[list[float], Field(min_length=9, max_length=10)]


class ImageUnits(Strict):
    image: Literal["px"]


class Intrinsics(Strict):
    fx: _Positive
    fy: _Positive
    cx: float
    cy: float
    skew: float = 0.0


class Lens(Strict):
    """A camera from its data sheet: for simulation, before any calibration."""

    focal_mm: _Positive
    pixel_um: _Positive


class Distortion(Strict):
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0


class CameraFile(Strict):
    """A camera.yaml: `intrinsics` in px, or a `lens` (square pixels, principal point in the middle)."""

    schema_: Literal["symcal/camera/1"] = Field(default="symcal/camera/1", alias="schema")
    units: ImageUnits
    width: Annotated[int, Field(gt=0, le=100_000)]
    height: Annotated[int, Field(gt=0, le=100_000)]
    intrinsics: Intrinsics | None = None
    lens: Lens | None = None
    distortion: Distortion = Distortion.model_construct()
    rms: Annotated[float, Field(ge=0)] | None = None
    covariance: Annotated[list[_Row], Field(min_length=9, max_length=10)] | None = None
    provenance: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.intrinsics is None) == (self.lens is None):
            raise PydanticCustomError(
                "camera", "a camera has 'intrinsics' (px) or a 'lens' (focal_mm, pixel_um): give one"
            )
        if self.covariance is not None and any(len(row) != len(self.covariance) for row in self.covariance):
            raise PydanticCustomError("camera", "a covariance has as many columns as rows: 9, or 10 with the skew")
        return self

    def camera(self) -> Camera:
        """The camera.

        Raises:
            InputError: a covariance that is not symmetric, or has a negative eigenvalue.
        """
        skew = 0.0
        if self.intrinsics is not None:
            skew = self.intrinsics.skew
            pinhole = (self.intrinsics.fx, self.intrinsics.fy, self.intrinsics.cx, self.intrinsics.cy)
        elif self.lens is not None:
            focal = 1000 * self.lens.focal_mm / self.lens.pixel_um
            pinhole = (focal, focal, (self.width - 1) / 2, (self.height - 1) / 2)
        d = self.distortion
        covariance = None if self.covariance is None else np.array(self.covariance)
        if covariance is not None:
            variances = np.diag(covariance)
            scale = np.sqrt(np.where(variances > 0, variances, 1.0))
            correlation = covariance / np.outer(scale, scale)
            if not np.allclose(correlation, correlation.T) or np.linalg.eigvalsh(correlation)[0] < -1e-6:
                names = ", ".join(NUMBER_NAMES[: len(covariance)])
                raise InputError(f"not a covariance (symmetric, no negative eigenvalue) of {names}", key="covariance")
        dist = (d.k1, d.k2, d.p1, d.p2, d.k3)
        return Camera(self.width, self.height, *pinhole, dist, covariance, self.rms, skew)


class Triangle(Strict):
    side: _Positive


class TargetFile(Strict):
    """A target.yaml: an equilateral `triangle` or named `points`, discs of one radius, where they are mounted."""

    schema_: Literal["symcal/target/1"] = Field(default="symcal/target/1", alias="schema")
    units: RobotUnits
    disc_radius: _Positive
    triangle: Triangle | None = None
    points: dict[str, _Triple] | None = None
    normal: _Triple = Field(default_factory=lambda: [0.0, 0.0, 1.0])
    marked: str | None = None
    mount: Frame | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.triangle is None) == (self.points is None):
            raise PydanticCustomError("target", "a target is a 'triangle' (side) or named 'points': give one")
        if self.triangle is not None and self.normal != [0.0, 0.0, 1.0]:
            raise PydanticCustomError("target", "the discs of a triangle face along +z: leave 'normal' out")
        return self

    def target(self) -> Target:
        """The target, in mm."""
        length, angle = LENGTH[self.units.length], ANGLE[self.units.angle]
        mount = None if self.mount is None else self.mount.matrix(length, angle)
        radius = self.disc_radius * length
        if self.triangle is not None:
            return Target.triangle(self.triangle.side * length, radius, self.marked, mount)
        points = self.points or {}
        coordinates = np.array(list(points.values())).reshape(-1, 3) * length
        x, y, z = self.normal
        return Target(tuple(points), coordinates, radius, (x, y, z), self.marked, mount)


def camera_to_dict(camera: Camera, provenance: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """The content of a camera.yaml, with plain numbers only."""
    result: dict[str, Any] = {
        "schema": "symcal/camera/1",
        "units": {"image": "px"},
        "width": camera.width,
        "height": camera.height,
        "intrinsics": dict(zip(INTRINSIC_NAMES[:4], camera.intrinsics[:4].tolist(), strict=True)),
        "distortion": dict(zip(INTRINSIC_NAMES[4:], camera.intrinsics[4:].tolist(), strict=True)),
    }
    if camera.skew:
        result["intrinsics"]["skew"] = float(camera.skew)
    if camera.rms_px is not None:
        result["rms"] = float(camera.rms_px)
    if camera.covariance is not None:
        result["covariance"] = camera.covariance.tolist()
    if provenance:
        result["provenance"] = dict(provenance)
    return result


def camera_from_dict(data: Mapping[str, Any], name: Path | str = "camera") -> Camera:
    """The camera that `camera_to_dict` wrote; `name` is for messages.

    Raises:
        InputError: unknown or missing keys, wrong types, impossible numbers.
    """
    return _camera(Document(Path(name), dict(data), {}))


def read_camera(path: Path | str) -> Camera:
    """Camera of a camera.yaml.

    Raises:
        InputError: with file, line and key.

    Example:
        >>> import symcal as sc
        >>> camera = sc.read_camera("configs/vision/camera_data_sheet.yaml")
        >>> camera.width, camera.height
        (2448, 2048)
    """
    return _camera(read_document(path))


def write_camera(path: Path | str, camera: Camera, provenance: Mapping[str, Any] | None = None) -> None:
    """Write a camera.yaml that `read_camera` reads back to the same numbers.

    Example:
        >>> import symcal as sc
        >>> camera = sc.read_camera("configs/vision/camera_data_sheet.yaml")
        >>> sc.write_camera("camera.yaml", camera)
        >>> sc.read_camera("camera.yaml").fx == camera.fx
        True
    """
    write_document(path, camera_to_dict(camera, provenance))


def target_to_dict(target: Target) -> dict[str, Any]:
    """The content of a target.yaml, with plain numbers only, in mm and rad."""
    result: dict[str, Any] = {
        "schema": "symcal/target/1",
        "units": {"length": "mm", "angle": "rad"},
        "disc_radius": float(target.disc_radius),
        "points": dict(zip(target.names, target.points.tolist(), strict=True)),
        "normal": [float(c) for c in target.normal],
    }
    if target.marked is not None:
        result["marked"] = target.marked
    if target.mount is not None:
        pose = spatial.matrix_pose(target.mount).tolist()
        result["mount"] = {"xyz": pose[:3], "quat_xyzw": pose[3:]}
    return result


def read_target(path: Path | str) -> Target:
    """Target of a target.yaml.

    Raises:
        InputError: with file, line and key.
    """
    return _target(read_document(path))


def target_from_dict(data: Mapping[str, Any], name: Path | str = "target") -> Target:
    """The target that `target_to_dict` wrote; `name` is for messages.

    Raises:
        InputError: unknown or missing keys, wrong types, impossible numbers.
    """
    return _target(Document(Path(name), dict(data), {}))


def write_target(path: Path | str, target: Target) -> None:
    """Write a target.yaml that `read_target` reads back to the same target."""
    write_document(path, target_to_dict(target))


def _camera(document: Document) -> Camera:
    file = validate(document, CameraFile)
    try:
        return file.camera()
    except InputError as error:
        raise _located(document, error) from None


def _target(document: Document) -> Target:
    file = validate(document, TargetFile)
    try:
        return file.target()
    except InputError as error:
        raise _located(document, error) from None


def _located(document: Document, error: InputError) -> InputError:
    """An error of the geometry, with its place in the file."""
    return document.error(error.message, (error.key or "",), found=error.found, allowed=error.allowed)
