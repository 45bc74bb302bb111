"""Camera pose and target mount fitted to image points with the nominal kinematics: nobody has to type them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.data.dataset import Dataset
from symcal.errors import InputError
from symcal.fit.estimation import Options, fit
from symcal.fit.residual_rows import rows_of
from symcal.model.measurement import Setup
from symcal.model.model import Model
from symcal.model.task import CAMERA, Scene
from symcal.placing.camera_placement import CameraPlacement, place_camera, target_poses
from symcal.placing.ends import Ends

Array = NDArray[np.float64]


def place_scene(model: Model, scene: Scene, data: Dataset, options: Options) -> Setup:
    """The frames of a `pixels` model as nominal kinematics and the image points have them.

    Intrinsics stay at their calibrated values here: only the identification moves them, within their prior.

    Raises:
        RefusedError: image points from which neither camera nor mount can be found.
    """
    if not model.frames:
        return model.setup
    plain = replace(options, solver="levenberg_marquardt", loss="linear", sigma={})
    best, least = model.setup, np.inf
    for guess in _guesses(model, scene, data):
        rows = rows_of(model.measurement, data, guess, model.residuals)
        if not np.isfinite(rows(np.zeros(len(model.parameters)))[0]).all():
            continue
        found = fit(rows, model.frames, plain)
        left = float(np.sum(rows(found.x)[0] ** 2))
        if left < least:
            best = model.moved(guess, found.x)
            least = left
    return best


def flange_poses(model: Model, q: Array) -> Array:
    """T_world_flange by nominal kinematics, shape (N, 4, 4), mm, at joint readings (N, dof)."""
    nominal = Setup(model.setup.base, np.eye(4)).vector
    return np.asarray(model.flange(q, np.zeros(len(model.parameters)), nominal)[0])


def _guesses(model: Model, scene: Scene, data: Dataset) -> list[Setup]:
    pixels = data.z.reshape(len(data), -1, 2)
    guesses = []
    if scene.T_world_camera is not None:
        guesses.append(CameraPlacement(scene.T_world_camera, model.setup.tool, np.inf))
    (observation,) = model.task.observations
    loose = model.task.tool or bool(observation.target.unknown_points)
    free_camera = observation.at.unknown and not any(n.startswith("camera_") for n in model.task.fix)
    free_mount = loose and not any(n.startswith("tool_") for n in model.task.fix)
    if free_camera or free_mount:
        guesses += place_camera(
            scene.camera,
            scene.target,
            flange_poses(model, data.q),
            target_poses(scene.camera, scene.target, pixels),
            pixels,
            base=None if free_camera else spatial.inverse(model.setup.places[CAMERA]),
            mount=None if free_mount else model.setup.tool,
        )
    return [_setup(model, scene, guess) for guess in guesses]


def _setup(model: Model, scene: Scene, guess: CameraPlacement) -> Setup:
    places = {**model.setup.places, CAMERA: guess.camera} if model.setup.places else {}
    if not model.task.observations[0].target.unknown_points:
        return replace(model.setup, places=places, tool=guess.mount)
    in_tool = spatial.inverse(model.setup.tool) @ guess.mount
    points = scene.target.points @ in_tool[:3, :3].T + in_tool[:3, 3]
    return replace(model.setup, places=places, points=points)


def camera_guesses(ends: Ends, data: Dataset, chain: Array, setup: Setup) -> Setup:
    """A camera among other instruments, placed by the consensus of its image points alone.

    Args:
        data: what it has read. chain: the robot's part between its two ends, shape (N, 4, 4), mm.
    Raises:
        InputError: neither a board nor discs. RefusedError: image points that do not agree on a place.
    """
    observation = ends.observation
    camera, marks = observation.instrument.camera, observation.target.board or observation.target.marks
    if camera is None or marks is None:
        raise InputError("a camera needs to know its target", key=f"measurements.{observation.name}.target")
    left, right = ends.left_unknown, ends.right_mode
    if not left and right is None:
        return setup
    known = ends.registration(setup)
    pixels = data.z.reshape(len(data), -1, 2)
    guess = place_camera(
        camera,
        marks,
        chain,
        target_poses(camera, marks, pixels),
        pixels,
        base=None if left else known.base,
        mount=None if right else known.tool,
    )[0]
    return ends.placed(setup, replace(known, base=spatial.inverse(guess.camera), tool=guess.mount))
