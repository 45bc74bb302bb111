"""Images of a simulated measurement: views of a board for the camera, and of the target at every pose of a plan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.camera.board import Board
from symcal.camera.camera import Camera
from symcal.camera.target import Target
from symcal.images.examples import Example
from symcal.images.measure import MeasuredImages
from symcal.images.shots import Shot
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.model.task import CAMERA
from symcal.vision.board import BoardDetection, Refusal, detect_board
from symcal.vision.board_views import board_views
from symcal.vision.calibrate import CameraCalibration, calibrate_camera
from symcal.vision.images import Image
from symcal.vision.render import Look, render_board, render_discs

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RenderedImages:
    """The camera's calibration, the measurement with it, and some of the images."""

    camera: CameraCalibration
    measured: MeasuredImages
    examples: tuple[Example, ...]


def calibrate_rendered(
    camera: Camera,
    board: Board,
    views: int,
    look: Look,
    rng: np.random.Generator,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[CameraCalibration, Image]:
    """The calibration that rendered views of a board give, and the first of the images.

    Args:
        camera: the true one.
    """
    detections: list[BoardDetection] = []
    refusals: list[Refusal] = []
    first: Image | None = None
    for i, pose in enumerate(board_views(camera, board, views, rng)):
        progress(f"rendering view {i + 1} of {views} of the board")
        image = render_board(camera, board, pose, rng, look)
        first = image if first is None else first
        found = detect_board(image, board, f"board {i + 1}")
        if isinstance(found, BoardDetection):
            detections.append(found)
        else:
            refusals.append(found)
    assert first is not None
    progress(f"calibrating the camera from {len(detections)} views")
    return calibrate_camera(detections, board, refusals), first


def target_poses(model: Model, x: Array, q: Array) -> Array:
    """T_camera_target of a robot with errors x at joint readings (N, dof), shape (N, 4, 4), mm."""
    setup = model.setup
    camera = model.moved(setup, x).places[CAMERA]
    tool = model.flange(q, x, Setup(setup.base, setup.tool).vector)[0]
    return np.asarray(spatial.inverse(camera) @ tool)


def target_shots(
    camera: Camera, target: Target, poses: Array, q: Array, look: Look, seeds: Sequence[np.random.SeedSequence]
) -> list[Shot]:
    """Images of the target at poses T_camera_target, shape (N, 4, 4), rendered when asked for, and always alike."""
    return [
        Shot(f"pose {i + 1}", str(i + 1), "train", q[i], _renderer(camera, target, pose, look, seed))
        for i, (pose, seed) in enumerate(zip(poses, seeds, strict=True))
    ]


def _renderer(
    camera: Camera, target: Target, pose: Array, look: Look, seed: np.random.SeedSequence
) -> Callable[[], Image]:
    return lambda: render_discs(camera, target, pose, np.random.default_rng(seed), look)
