"""A simulated experiment with a camera: plan, images or image points, identification, errors against the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.aligned import aligned_errors, centres, target_points
from symcal.calibration.calibrate import Calibration, baseline_model, calibrate
from symcal.calibration.compensation_check import true_robot
from symcal.calibration.evaluate import Errors
from symcal.calibration.simulate import simulate
from symcal.camera.camera import Camera
from symcal.camera.files import read_camera
from symcal.config import conversion as config
from symcal.config.conversion import ExperimentFile, RenderedData, SimulatedData
from symcal.data.dataset import Dataset
from symcal.documents.document import Document
from symcal.errors import RefusedError
from symcal.fit.estimation import Options
from symcal.images.comparison import Ways, compare_ways
from symcal.images.examples import Example
from symcal.images.facts import accuracy_facts, camera_facts, comparison_facts, image_facts, project_poses
from symcal.images.measure import MeasuredImages, measure_images
from symcal.images.rendered import RenderedImages, calibrate_rendered, target_poses, target_shots
from symcal.images.shots import Shot
from symcal.instruments import seen_by
from symcal.model.model import Model, State, build_model
from symcal.model.task import Scene, Task, pixels_task
from symcal.planning.area import draw
from symcal.planning.drive_plan import Planned, find_plan, plan_generator
from symcal.planning.plan_problem import PlanProblem, plan_problem
from symcal.robot.robot import Robot
from symcal.vision.calibrate import CameraCalibration
from symcal.vision.images import Image
from symcal.vision.render import Look

Array = NDArray[np.float64]
Progress = Callable[[str], None]

AGAINST = "truth, after one rigid alignment"
ERROR = "error of the target's centre"


@dataclass(frozen=True, slots=True)
class ImageRun:
    """What an experiment with a camera has brought about.

    data: image points of the training poses. model, calibration: with the camera as calibrated. truth: the true robot.
    errors: of the target's centre at training and unseen test poses, by state. test: joint readings of the latter.
    ways: the same image points by other ways, with their errors; None where P3P does not apply.
    images: of a rendered experiment. facts: of results.json.
    """

    planned: Planned | None
    data: Dataset
    model: Model
    calibration: Calibration
    truth: Robot
    errors: dict[str, Mapping[str, Errors]]
    test: Array
    ways: Ways | None
    way_errors: Mapping[str, Errors]
    images: RenderedImages | None
    facts: dict[str, Any]
    notes: tuple[str, ...]
    inputs: tuple[Path, ...]


def run_images(
    file: ExperimentFile, document: Document, model: Model, options: Options, seed: int, progress: Progress
) -> ImageRun:
    """Plan, measure, identify, judge.

    The identification is told nothing about where camera and mount are, unless the experiment says that they are known.

    Raises:
        InputError: what the experiment lacks. RefusedError: nothing can be planned, measured or identified.
    """
    source, scene = file.data, model.task.scene
    assert isinstance(source, SimulatedData | RenderedData)
    assert scene is not None
    short = file.measurement
    assert short is not None
    rng = np.random.default_rng(seed)
    for_truth, for_poses, for_board, for_noise = rng.spawn(4)
    problem, planned = _plan(file, document, model, seed, progress)
    q = planned.plan.poses if planned else draw(problem.area, for_poses, file.plan.poses, problem.feasible)
    test = draw(problem.area, for_poses, max(source.test_poses, 1), problem.feasible)
    inputs = [config.existing(document, str(short.camera), ("measurement", "camera"), "camera file")]
    inputs.append(config.existing(document, str(short.target), ("measurement", "target"), "target file"))
    lens, known = scene.camera, scene.camera
    if isinstance(source, RenderedData):
        inputs.append(config.existing(document, source.camera, ("data", "camera"), "camera file"))
        lens = read_camera(inputs[-1])
    true_model = build_model(model.robot, pixels_task(replace(scene, camera=lens), ("tool", "camera")))
    errors = _truth(source, file, document, true_model, for_truth)
    x = true_model.parameters.vector(errors)
    images: RenderedImages | None = None
    if isinstance(source, RenderedData):
        poses = target_poses(true_model, x, q)
        images = _render(source, document, model, lens, poses, q, (for_board, for_noise), progress)
        known, points = images.camera.camera, images.measured.data
    else:
        progress("simulating")
        noise = config.noise_of(file, source, model.task.observations)
        points = simulate(true_model, errors, q, noise, for_noise)
    own = build_model(model.robot, _telling(model.task, _told(model, replace(scene, camera=known))))
    progress("identifying")
    calibration = calibrate(own, baseline_model(own), points, options)
    true_state = State(true_model, true_model.setup, x)
    judged = {"train": points.q, "test": test}
    truths = {part: target_points(true_state, at) for part, at in judged.items()}
    found: dict[str, Mapping[str, Errors]] = {
        part: {
            name: aligned_errors(centres(target_points(state, at)), centres(truths[part]))
            for name, state in calibration.states.items()
        }
        for part, at in judged.items()
    }
    progress("comparing with P3P")
    notes = [*(images.measured.notes if images else ()), *points.notes, *calibration.notes]
    ways: Ways | None = None
    try:
        ways = compare_ways(calibration, replace(scene, camera=known), points, options)
        notes += ways.p3p.notes
    except RefusedError as error:
        notes.append(f"no comparison with P3P: {error}")
    way_errors = {} if ways is None else ways.errors(test, truths["test"])
    facts = accuracy_facts(calibration, points, truths["test"], test)
    if ways is not None:
        facts["comparison"] = comparison_facts(ways, way_errors)
    if images is not None:
        facts["images"] = image_facts(images, project_poses(lens, scene, target_poses(true_model, x, points.q)))
        facts["camera"] = camera_facts(images.camera, lens)
    return ImageRun(
        planned=planned,
        data=points,
        model=own,
        calibration=calibration,
        truth=true_robot(true_model, errors),
        errors=found,
        test=test,
        ways=ways,
        way_errors=way_errors,
        images=images,
        facts=facts,
        notes=tuple(notes),
        inputs=(*inputs, *problem.inputs),
    )


def _plan(
    file: ExperimentFile, document: Document, model: Model, seed: int, progress: Progress
) -> tuple[PlanProblem, Planned | None]:
    progress("planning")
    rng = plan_generator(seed)
    problem = plan_problem(file, document, model, rng)
    if file.plan.method is None:
        return problem, None
    return problem, find_plan(problem, file.plan.model_copy(update={"random": 0}), rng, progress)


def _truth(
    source: SimulatedData | RenderedData,
    file: ExperimentFile,
    document: Document,
    model: Model,
    rng: np.random.Generator,
) -> dict[str, float]:
    units = dict(zip(model.parameters.names, model.parameters.units, strict=True))
    return config.truth_of(source, file, document, dict(units), rng)


def _told(model: Model, scene: Scene) -> Scene:
    """The scene as the identification knows it: without what it is to find."""
    (observation,) = model.task.observations
    loose = model.task.tool or bool(observation.target.unknown_points)
    target = replace(scene.target, mount=None) if loose else scene.target
    return replace(scene, target=target, T_world_camera=None if observation.at.unknown else scene.T_world_camera)


def _telling(task: Task, scene: Scene) -> Task:
    """The task where camera, its place and the target are those of a scene."""
    (observation,) = task.observations
    kind = seen_by(scene.camera, calibrate=observation.instrument.has_unknowns)
    place = replace(observation.at, frame=scene.T_world_camera)
    return task.observed([replace(observation.with_marks(scene.target), instrument=kind, at=place)])


def _render(
    source: RenderedData,
    document: Document,
    model: Model,
    lens: Camera,
    poses: Array,
    q: Array,
    rngs: tuple[np.random.Generator, np.random.Generator],
    progress: Progress,
) -> RenderedImages:
    """Calibrate the camera from images of a board, and measure the target in images with the camera so known."""
    if source.board is None:
        raise document.error("say with which board the camera is calibrated", ("data", "board"))
    scene, (for_board, for_noise) = model.task.scene, rngs
    assert scene is not None
    look = Look(**source.image.model_dump())
    board = config.board_of(source.board, document, ("data", "board"))
    calibrated, image = calibrate_rendered(lens, board, source.views, look, for_board, progress)
    seeds = np.random.SeedSequence(int(for_noise.integers(2**63))).spawn(len(q))
    shots = target_shots(lens, scene.target, poses, q, look, seeds)
    told = _told(model, replace(scene, camera=calibrated.camera))
    measured = measure_images(
        shots, model.robot, told.camera, told.target, T_world_camera=told.T_world_camera, progress=progress
    )
    return RenderedImages(calibrated, measured, _examples(calibrated, image, measured, shots, source.examples))


def _examples(
    calibrated: CameraCalibration, image: Image, measured: MeasuredImages, shots: Sequence[Shot], count: int
) -> tuple[Example, ...]:
    """The first view of the board, and images of the target evenly among those that were measured."""
    if count == 0:
        return ()
    view = calibrated.views[0]
    chosen = sorted({int(i) for i in np.linspace(0, len(measured.images) - 1, count - 1)})
    load = {shot.name: shot.load for shot in shots}
    found = [(measured.images[i], measured.detections[i]) for i in chosen]
    return (
        Example(view.name, image, view.pixels, ()),
        *(Example(name, np.asarray(load[name]()), each.pixels, each.names) for name, each in found),
    )
