"""What all parts of the study share, made from an experiment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import Camera
from symcal.camera.target import Target
from symcal.config import conversion as config
from symcal.config.conversion import ExperimentFile, SimulatedData
from symcal.config.study import SceneConfig, StudyConfig
from symcal.documents.document import Document
from symcal.errors import RefusedError
from symcal.instruments.noise import Noise
from symcal.kernels import batch_function
from symcal.model.measurement import Measurement, Setup
from symcal.model.model import Model
from symcal.model.observation import Point
from symcal.model.observe import observe
from symcal.paper.results import Setting
from symcal.planning.camera_view import CameraView, camera_view, look_at
from symcal.planning.plan_problem import PlanProblem, plan_problem
from symcal.planning.region import TaskRegion, region_accuracy
from symcal.planning.search import SAMPLE
from symcal.planning.worst_pose import feasible_set

Array = NDArray[np.float64]


def study_setting(
    file: ExperimentFile,
    document: Document,
    model: Model,
    study: StudyConfig,
    for_problem: np.random.Generator,
    rng: np.random.Generator,
) -> tuple[Setting, PlanProblem]:
    """Convert what the study needs to mm and rad, and draw its test poses.

    Args:
        for_problem: randomness of the planning problem, as other commands use it.
    Raises:
        RefusedError: the experiment is not simulated, not about positions of one point with known frames, has no noise
            or test poses, the robot has joint terms, or the experiment says neither
            where the robot starts nor how fast its joints are.
    """
    data = file.data
    if not isinstance(data, SimulatedData) or not data.noise.sizes.get("position") or not data.test_poses:
        raise RefusedError("the study compares with a known truth: it needs simulated data with noise and test poses")
    if (
        len(model.task.observations) != 1
        or not model.task.observations[0].instrument.gives_point
        or len(model.task.observations[0].features) != 1
        or model.placement
    ):
        raise RefusedError(
            "the study is about positions of one point of a robot whose base and tool are known, as in the paper: "
            "measurement of type 'position' with one point and nothing to estimate"
        )
    if model.robot.terms:
        raise RefusedError(
            "the study is of a robot whose joints read what they are, as in the paper: leave 'terms' out of its file"
        )
    for_truth, for_test, for_sample = rng.spawn(3)
    problem = plan_problem(file, document, model, for_problem)
    if problem.start is None or problem.speeds is None:
        raise RefusedError("the study drives its plans as tours: give 'plan.start' and 'plan.speeds'")
    units = dict(zip(model.parameters.names, model.parameters.units, strict=True))
    truth = model.parameters.vector(config.truth_of(data, file, document, dict(units), for_truth))
    noise = Noise(data.noise.distribution, data.noise.sizes["position"] * file.units.factor("mm"))
    test = problem.area.sample(for_test, data.test_poses)
    predict = batch_function(model.measurement.predict)
    return (
        Setting(
            model=model,
            predict=predict,
            truth=truth,
            noise=noise,
            sigma=noise.sigma(noise.sizes["position"]),
            count=file.plan.poses,
            test_poses=test,
            test_positions=predict(test, truth, model.setup.vector)[0],
            nominal_positions=predict(test, np.zeros(len(truth)), model.setup.vector)[0],
            info=problem.info,
            where=feasible_set(problem.area, for_sample, SAMPLE),
            accuracy=region_accuracy(problem.info, TaskRegion(test)),
            view=_view(study.scene, file, model),
            margin_px=study.scene.margin_px,
            incidence=study.scene.incidence * file.units.factor("rad"),
            arm=problem.arm,
            start=problem.start,
            speeds=problem.speeds,
        ),
        problem,
    )


def _view(scene: SceneConfig, file: ExperimentFile, model: Model) -> CameraView:
    length, angle = file.units.factor("mm"), file.units.factor("rad")
    i = scene.intrinsics
    camera = Camera(scene.width, scene.height, i.fx, i.fy, i.cx, i.cy, skew=i.skew)
    target = Target.triangle(scene.triangle.side * length, scene.disc_radius * length)
    place = look_at(np.array(scene.position) * length, np.array(scene.look_at) * length)
    return camera_view(model.measurement.chain, model.setup, camera, place, target, scene.mount.matrix(length, angle))


def positions(setting: Setting, poses: Array, x: Array) -> Array:
    """Positions of the robot with errors x, shape (N, 3), mm."""
    return np.asarray(setting.predict(poses, x, setting.model.setup.vector)[0])


def target_measurement(setting: Setting) -> tuple[Measurement, Setup]:
    """Positions of all three target points instead of the last origin alone."""
    view, setup = setting.view, setting.model.setup
    (one,) = setting.model.task.observations
    points: dict[str, Point | None] = dict.fromkeys(view.target.names, (0.0, 0.0, 0.0))
    measurement = observe(setting.model.measurement.chain, replace(one, target=replace(one.target, points=points)))
    return measurement, Setup(setup.base, setup.tool, view.tool_points)
