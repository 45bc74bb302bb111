"""A simulated measurement of a board: images of a camera that nobody has told where it stands, measured like real ones.

The camera is calibrated from rendered views of a board; then the measured board is rendered at every posture of the
true robot, and found again by the same code that measures photographs (`symcal.images.boards`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.compensation_check import true_robot
from symcal.calibration.simulate import simulate
from symcal.camera.board import Board
from symcal.camera.camera import Camera
from symcal.camera.files import read_camera
from symcal.config import conversion as config
from symcal.config.conversion import ExperimentFile, RenderedData
from symcal.data.dataset import Dataset
from symcal.documents.document import Document
from symcal.images.entries import EntryImages, measure_entry
from symcal.images.rendered import calibrate_rendered
from symcal.images.shots import Shot, Shots
from symcal.instruments import kind_named, seen_by
from symcal.instruments.noise import Noise
from symcal.model.model import Model, build_model
from symcal.model.observation import Observation
from symcal.model.task import Task
from symcal.planning.area import WorkingArea, draw
from symcal.robot.robot import Robot
from symcal.spatial import pose_matrix
from symcal.vision.calibrate import CameraCalibration
from symcal.vision.images import Image
from symcal.vision.render import Look, render_board

Array = NDArray[np.float64]
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class RenderedBoards:
    """What was measured in the rendered images, and the truth behind them.

    model: with the camera as calibrated. lens: the true camera. exact: image points of unseen poses without noise.
    error_px: measured less true image points of each pose, shape (N, n, 2), NaN where nothing was seen.
    """

    entry: EntryImages
    model: Model
    calibration: CameraCalibration
    lens: Camera
    truth: Robot
    exact: Dataset
    error_px: Array
    inputs: tuple[Path, ...]


def render_boards(
    file: ExperimentFile,
    source: RenderedData,
    document: Document,
    model: Model,
    rng: np.random.Generator,
    progress: Progress,
    planned: Array | None = None,
) -> RenderedBoards:
    """Calibrate the camera, render the board at planned or random poses that show enough of it, and measure.

    Args:
        planned: poses to measure at, shape (N, dof); random ones that see enough of the board when None.
    Raises:
        InputError: not one camera that looks at a board, or a file that is not there. RefusedError: nothing is seen.
    """
    observation = _observation(model, document)
    path = config.existing(document, source.camera, ("data", "camera"), "camera file")
    lens = read_camera(path)
    for_truth, for_poses, for_board, for_noise = rng.spawn(4)
    true_model = build_model(model.robot, _seen_by(model.task, lens, calibrate=False))
    units = dict(zip(true_model.parameters.names, true_model.parameters.units, strict=True))
    errors = config.truth_of(source, file, document, units, for_truth)
    area = WorkingArea(*config.area_of(file, document, model.robot))
    least = round(source.seen * len(observation.features))

    def enough(q: Array) -> NDArray[np.bool_]:
        seen = np.isfinite(simulate(true_model, {}, q, Noise(), for_poses).z[:, ::2]).sum(axis=1)
        return np.asarray(seen >= max(least, 1))

    q = draw(area, for_poses, file.plan.poses, enough) if planned is None else planned
    test = draw(area, for_poses, source.test_poses, enough)
    look = Look(**source.image.model_dump())
    calibration, _ = calibrate_rendered(
        lens, _board(source, observation, document), source.views, look, for_board, progress
    )
    own = build_model(
        model.robot, _seen_by(model.task, calibration.camera, calibrate=observation.instrument.has_unknowns)
    )
    shots = _shots(lens, observation, _true_poses(true_model, errors, q), q, look, for_noise)
    entry = measure_entry(own.task.observations[0], shots, model.robot, progress, source.examples)
    exact = simulate(true_model, errors, q, Noise(), for_noise)
    rows = [exact.labels.index(str(int(label) - 1)) for label in entry.data.labels]
    return RenderedBoards(
        entry=entry,
        model=own,
        calibration=calibration,
        lens=lens,
        truth=true_robot(true_model, errors),
        exact=simulate(true_model, errors, test, Noise(), for_noise, "test"),
        error_px=(entry.data.z - exact.z[rows]).reshape(len(rows), -1, 2),
        inputs=(path,),
    )


def _observation(model: Model, document: Document) -> Observation:
    (first, *others) = model.task.observations
    if others or first.instrument.camera is None or first.target.board is None:
        message = "images are rendered for one camera ('instrument: pixels') that looks at a target with 'board'"
        raise document.error(message, ("data", "source"))
    return first


def _board(source: RenderedData, observation: Observation, document: Document) -> Board:
    """What the camera is calibrated with: the measured board, if nothing else is said."""
    assert observation.target.board is not None
    if source.board is None:
        return observation.target.board
    return config.board_of(source.board, document, ("data", "board"))


def _seen_by(task: Task, camera: Camera, *, calibrate: bool) -> Task:
    """The task with another camera in the place of its own."""
    (observation,) = task.observations
    return task.observed([replace(observation, instrument=seen_by(camera, calibrate=calibrate))])


def _true_poses(model: Model, errors: dict[str, float], q: Array) -> Array:
    """T_camera_board at joint readings (N, dof), shape (N, 4, 4), mm: what an instrument that reads poses would say."""
    (observation,) = model.task.observations
    target = replace(observation.target, board=None, points={})
    posed = replace(observation, instrument=kind_named("pose")(), target=target, noise={})
    whole = build_model(model.robot, model.task.observed([posed]))
    known = {name: value for name, value in errors.items() if name in whole.parameters.names}
    return np.asarray(pose_matrix(simulate(whole, known, q, Noise(), np.random.default_rng(0)).z))


def _shots(
    lens: Camera, observation: Observation, poses: Array, q: Array, look: Look, rng: np.random.Generator
) -> Shots:
    """Images of the board, rendered when asked for, and always alike."""
    board = observation.target.board
    assert board is not None
    seeds = np.random.SeedSequence(int(rng.integers(2**63))).spawn(len(q))
    return Shots.of(
        [
            Shot(f"pose {i + 1}", str(i + 1), "train", q[i], _renderer(lens, board, pose, look, seed))
            for i, (pose, seed) in enumerate(zip(poses, seeds, strict=True))
        ]
    )


def _renderer(lens: Camera, board: Board, pose: Array, look: Look, seed: np.random.SeedSequence) -> Callable[[], Image]:
    return lambda: render_board(lens, board, pose, np.random.default_rng(seed), look)
