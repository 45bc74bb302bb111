"""Constraints as an experiment file states them: cameras, boxes and planes, with the place of every mistake."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.camera.files import CameraFile, ImageUnits, TargetFile, read_camera, read_target
from symcal.camera.target import Target
from symcal.config import conversion as config
from symcal.config.conversion import ExperimentFile
from symcal.config.plan import CameraConstraint, KeepOutBox, KeepOutPlane
from symcal.documents.document import Document, Key
from symcal.errors import InputError
from symcal.model.model import Model
from symcal.model.task import Scene
from symcal.planning.camera_view import CameraView, camera_view
from symcal.planning.clearance import keep_out, plane
from symcal.planning.constraints import Constraint
from symcal.planning.skeleton import Skeleton
from symcal.planning.visibility import View, visibility
from symcal.robot.schema import Frame
from symcal.robot.schema import RobotUnits as FrameUnits
from symcal.units import ANGLE, LENGTH

Array = NDArray[np.float64]

_INCIDENCE = 60.0  # deg; beyond, a disc's image is a sliver


@contextmanager
def _at(document: Document, key: Key) -> Iterator[None]:
    """Give errors of the geometry their place in the file."""
    try:
        yield
    except InputError as error:
        if error.file is not None:
            raise
        inner: Key = (*key, error.key) if error.key else key
        raise document.error(error.message, inner, found=error.found, allowed=error.allowed) from None


def clearance(file: ExperimentFile, document: Document, arm: Skeleton) -> tuple[Constraint, ...]:
    """Boxes and planes that the links keep clear of, measuring or moving."""
    length, angle = file.units.factor("mm"), file.units.factor("rad")
    made = []
    for i, box in enumerate(file.plan.constraints.keep_out):
        with _at(document, ("plan", "constraints", "keep_out", i)):
            made.append(_box(arm, box, length, angle))
    for i, wall in enumerate(file.plan.constraints.planes):
        with _at(document, ("plan", "constraints", "planes", i)):
            made.append(_plane(arm, wall, length))
    return tuple(made)


def _box(arm: Skeleton, box: KeepOutBox, length: float, angle: float) -> Constraint:
    frame = Frame(xyz=box.xyz, rpy=box.rpy).matrix(length, angle)
    size = np.array(box.size) * length
    return keep_out(arm, box.name, frame, size, margin=box.margin * length, first_link=box.first_link)


def _plane(arm: Skeleton, wall: KeepOutPlane, length: float) -> Constraint:
    point, normal = np.array(wall.point) * length, np.array(wall.normal)
    return plane(arm, wall.name, point, normal, margin=wall.margin * length, first_link=wall.first_link)


def separate_camera(
    wanted: CameraConstraint, file: ExperimentFile, document: Document, model: Model, inputs: list[Path]
) -> tuple[CameraView, tuple[Constraint, ...]]:
    """A camera that the measurement itself does not know of; files that were read are added to ``inputs``."""
    key: Key = ("plan", "constraints", "camera")
    length, angle = file.units.factor("mm"), file.units.factor("rad")
    if wanted.file is not None:
        path = config.existing(document, wanted.file, (*key, "file"), "camera file")
        inputs.append(path)
        camera = read_camera(path)
    else:
        given = wanted.model_dump(include={"width", "height", "intrinsics", "lens", "distortion"}, exclude_none=True)
        camera = CameraFile(units=ImageUnits(image="px"), **given).camera()
    target, mount = _target(wanted, file, document, key, inputs)
    with _at(document, (*key, "placement")):
        T_world_camera = wanted.placement.matrix(length, angle)
    view = camera_view(model.measurement.chain, model.setup, camera, T_world_camera, target, mount)
    depth = (0.0, np.inf) if wanted.depth is None else (wanted.depth[0] * length, wanted.depth[1] * length)
    incidence = np.deg2rad(_INCIDENCE) if wanted.incidence is None else wanted.incidence * angle
    return view, visibility(view, margin=wanted.margin_px, depth=depth, incidence=incidence)


def asked_view(file: ExperimentFile) -> View:
    """What is said under `plan.constraints.view`; what is not said there, instruments and targets know."""
    limits, length, given = file.plan.constraints.view, file.units.factor("mm"), View()
    return View(
        limits.margin_px if "margin_px" in limits.model_fields_set else given.margin,
        given.depth if limits.depth is None else (limits.depth[0] * length, limits.depth[1] * length),
        None if limits.incidence is None else limits.incidence * file.units.factor("rad"),
        limits.whole,
    )


def own_camera(
    scene: Scene, file: ExperimentFile, document: Document, model: Model
) -> tuple[CameraView, tuple[Constraint, ...]]:
    """The camera of a pixel measurement, where the experiment says that it roughly is."""
    if scene.T_world_camera is None:
        message = "planning needs to know roughly where the camera is"
        raise document.error(message, ("measurement", "camera_pose"))
    limits, length = file.plan.constraints.view, file.units.factor("mm")
    view = camera_view(
        model.measurement.chain, model.setup, scene.camera, scene.T_world_camera, scene.target, np.eye(4)
    )
    depth = (0.0, np.inf) if limits.depth is None else (limits.depth[0] * length, limits.depth[1] * length)
    incidence = np.deg2rad(_INCIDENCE) if limits.incidence is None else limits.incidence * file.units.factor("rad")
    return view, visibility(view, margin=limits.margin_px, depth=depth, incidence=incidence)


def _target(
    wanted: CameraConstraint, file: ExperimentFile, document: Document, key: Key, inputs: list[Path]
) -> tuple[Target, Array]:
    if isinstance(wanted.target, str):
        path = config.existing(document, wanted.target, (*key, "target"), "target file")
        inputs.append(path)
        target = read_target(path)
        return target, np.eye(4) if target.mount is None else target.mount
    shape, units = wanted.target, FrameUnits(length=file.units.length, angle=file.units.angle)
    with _at(document, (*key, "target")):
        made = TargetFile(
            units=units, disc_radius=shape.disc_radius, triangle=shape.triangle, points=shape.points, mount=shape.mount
        ).target()
    return made, shape.mount.matrix(LENGTH[units.length], ANGLE[units.angle])
