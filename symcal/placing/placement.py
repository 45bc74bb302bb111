"""The frames of the nominal robot fitted to data: closed forms for first guesses, then least squares on the frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from symcal.data.dataset import Dataset
from symcal.fit.estimation import Fit, Options, fit
from symcal.fit.residual_rows import rows_of
from symcal.instruments import Setup
from symcal.model.model import Model
from symcal.parameters import frame_names, point_names
from symcal.placing.registration import LEVER, Registration, hand_eye, register, virtual_points
from symcal.placing.scene_placement import place_scene
from symcal.spatial import inverse, pose_matrix

Array = NDArray[np.float64]


def place(model: Model, data: Dataset, options: Options) -> Setup:
    """The model's frames and points as nominal kinematics and the data have them; always by Levenberg-Marquardt.

    A frame of which something is held starts from nominal, so that what is held stays as it was.
    """
    if not model.placement:
        return model.setup
    if model.task.scene is not None:
        return place_scene(model, model.task.scene, data, options)
    options = replace(options, solver="levenberg_marquardt")
    guesses = _guesses(model, data)
    if len(guesses) > 1:
        size = max(min(g.rms for g in guesses) / np.sqrt(3), model.measurement.groups[0].floor)
        plain = replace(options, loss="linear", sigma={"position": size, "orientation": size / LEVER})
        guesses = sorted(guesses, key=lambda g: _total(model, data, _fit(model, data, g, plain)))
    found = _fit(model, data, guesses[0], options)
    return found.setup.moved(model.parameters.mapping(found.x), model.measurement.point_names)


def stated(model: Model, setup: Setup) -> Array:
    """The frames and points that the robot and the task state, as errors from a setup, shape (n,).

    That is where priors are centred: what is known of a frame is known of the stated one, wherever it is found.
    """
    errors: dict[str, float] = {}
    frames = [("base", setup.base, model.setup.base), ("tool", setup.tool, model.setup.tool)]
    if setup.camera is not None and model.setup.camera is not None:
        frames.append(("camera", setup.camera, model.setup.camera))
    for name, frame, nominal in frames:
        step = inverse(frame) @ nominal
        turn = Rotation.from_matrix(step[:3, :3]).as_rotvec()
        errors |= dict(zip(frame_names(name), (*step[:3, 3], *turn), strict=True))
    for name, shift in zip(model.measurement.point_names, model.setup.points - setup.points, strict=True):
        errors |= dict(zip(point_names(name), shift, strict=True))
    return np.array([float(errors.get(name, 0.0)) for name in model.parameters.names])


def _guesses(model: Model, data: Dataset) -> list[Registration]:
    task = model.task
    flange, _, _ = model.flange(data.q, np.zeros(len(model.parameters)), Setup(np.eye(4), np.eye(4)).vector)
    nominal = Registration(model.setup.base, model.setup.tool, model.setup.points, np.inf)
    base = "base" in task.estimate and not any(name.startswith("base_") for name in task.fix)
    tool = None if any(name.startswith("tool_") for name in task.fix) else task.tool
    starts: tuple[Registration, ...] = ()
    if not task.instrument.reads_points:
        poses = pose_matrix(data.z)
        poses = inverse(poses) if task.invert else poses
        nominal = replace(nominal, points=virtual_points(np.eye(4)[None])[0])
        if base and tool and len(data) >= 3:
            first_base, first_tool = hand_eye(flange, poses)
            starts = (replace(nominal, base=first_base, tool=first_tool),)
        targets = virtual_points(poses)
    else:
        targets = data.z.reshape(len(data), -1, 3)
    return register(flange, targets, nominal, base=base, tool=tool, starts=starts)


def _fit(model: Model, data: Dataset, guess: Registration, options: Options) -> Fit:
    points = guess.points if model.measurement.point_names else model.setup.points
    setup = Setup(guess.base, guess.tool, points)
    rows = rows_of(model.measurement, data, setup, model.residual)
    return fit(rows, model.placement, options, prior_mean=stated(model, setup))


def _total(model: Model, data: Dataset, candidate: Fit) -> float:
    """Squared residuals of a placement with poses seen as points, so that guesses are compared in one unit."""
    r, _ = rows_of(model.measurement, data, candidate.setup, model.residual)(candidate.x)
    return float(np.sum((r * model.measurement.per_component({"position": 1.0, "orientation": LEVER})) ** 2))
