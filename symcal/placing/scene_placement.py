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
from symcal.instruments import Setup
from symcal.model.model import Model, Scene
from symcal.placing.camera_placement import CameraPlacement, place_camera, target_poses

Array = NDArray[np.float64]


def place_scene(model: Model, scene: Scene, data: Dataset, options: Options) -> Setup:
    """The frames of a `pixels` model as nominal kinematics and the image points have them.

    Intrinsics stay at their calibrated values here: only the identification moves them, within their prior.

    Raises:
        InputError: a camera that is neither estimated nor given.
        RefusedError: image points from which neither camera nor mount can be found.
    """
    if scene.T_world_camera is None and "camera" not in model.task.estimate:
        message = "the camera's pose is neither known nor to be estimated"
        raise InputError(message, key="measurement.estimate", allowed=["camera"])
    if not model.frames:
        return model.setup
    plain = replace(options, solver="levenberg_marquardt", loss="linear", sigma={})
    best, least = model.setup, np.inf
    for guess in _guesses(model, scene, data):
        rows = rows_of(model.measurement, data, guess, model.residual)
        if not np.isfinite(rows(np.zeros(len(model.parameters)))[0]).all():
            continue
        found = fit(rows, model.frames, plain)
        left = float(np.sum(rows(found.x)[0] ** 2))
        if left < least:
            best = guess.moved(model.parameters.mapping(found.x), model.measurement.point_names)
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
    free_camera = "camera" in model.task.estimate and not any(n.startswith("camera_") for n in model.task.fix)
    free_mount = model.task.tool is not None and not any(n.startswith("tool_") for n in model.task.fix)
    if free_camera or free_mount:
        assert model.setup.camera is not None
        guesses += place_camera(
            scene.camera,
            scene.target,
            flange_poses(model, data.q),
            target_poses(scene.camera, scene.target, pixels),
            pixels,
            base=None if free_camera else spatial.inverse(model.setup.camera),
            mount=None if free_mount else model.setup.tool,
        )
    return [_setup(model, scene, guess) for guess in guesses]


def _setup(model: Model, scene: Scene, guess: CameraPlacement) -> Setup:
    if model.task.tool != "points":
        return replace(model.setup, camera=guess.camera, tool=guess.mount)
    in_tool = spatial.inverse(model.setup.tool) @ guess.mount
    return replace(model.setup, camera=guess.camera, points=scene.target.points @ in_tool[:3, :3].T + in_tool[:3, 3])
