"""The same images, identified in four ways: by their pixels, and by one P3P solution per image as in the paper.

pixels          all image points at once, with the camera's calibration as a prior
p3p             the centroid of the three P3P points of each image, as in the paper
p3p_points      the three points, taken as equally certain in all directions
p3p_covariance  the three points with their full covariance
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.calibration.aligned import aligned_errors, centres, target_points
from symcal.calibration.calibrate import Calibration
from symcal.calibration.evaluate import Errors
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Fit, Options, fit
from symcal.fit.residual_rows import rows_of
from symcal.images.p3p_data import P3PData, p3p_positions
from symcal.model.measurement import Setup
from symcal.model.model import Model, State, build_model
from symcal.model.observation import Point
from symcal.model.task import CAMERA, Scene, Task
from symcal.placing.placement import place
from symcal.placing.scene_placement import flange_poses

Array = NDArray[np.float64]

CENTRE = "centroid"


@dataclass(frozen=True, slots=True)
class Way:
    """One way to identify from the images: its model, its result, and the poses that it could use."""

    state: State
    fit: Fit
    poses: int


@dataclass(frozen=True, slots=True)
class Ways:
    """The ways by name, the P3P solutions behind all but the first, and what is to be said about them."""

    ways: Mapping[str, Way]
    p3p: P3PData

    def errors(self, q: Array, truth: Array) -> dict[str, Errors]:
        """Errors of the target's centre, by way, at joint readings (N, dof); true points, shape (N, k, 3), mm."""
        return {
            name: aligned_errors(centres(target_points(way.state, q)), centres(truth))
            for name, way in self.ways.items()
        }


def compare_ways(calibration: Calibration, scene: Scene, data: Dataset, options: Options) -> Ways:
    """Identify from P3P positions what ``calibration`` has identified from the pixels of the same training poses.

    Raises:
        RefusedError: a target of other than three points, or images that P3P cannot solve.
    """
    train = data.part("train")
    model, setup = calibration.model, calibration.setup
    predicted = spatial.inverse(setup.places[CAMERA]) @ flange_poses(model, train.q) @ setup.tool
    sigma = calibration.after.sigmas.get("image") or float(np.sqrt(np.nanmean(_sigma(train) ** 2)))
    solved = p3p_positions(train, scene.camera, scene.target, predicted, sigma)
    plain = replace(options, sigma={})
    by_points = _in_camera(model, setup, scene.target.by_name)
    by_centroid = _in_camera(model, setup, {CENTRE: (0.0, 0.0, 0.0)})
    ways = {"pixels": Way(calibration.states["after"], calibration.after, len(train))}
    for name, own, measured in (
        ("p3p", by_centroid, solved.centroid),
        ("p3p_points", by_points, replace(solved.points, covariance=None)),
        ("p3p_covariance", by_points, solved.points),
    ):
        found = fit(
            rows_of(own.measurement, measured, place(own, measured, plain), own.residuals),
            (*own.kinematic, *own.placement),
            plain,
        )
        ways[name] = Way(State(own, found.setup, found.x), found, len(measured))
    return Ways(ways, solved)


def _in_camera(model: Model, setup: Setup, points: Mapping[str, Point]) -> Model:
    """The robot measured by positions in the camera's frame, its place there and the mount unknown."""
    fix = tuple(name for name in model.task.fix if name in model.robot.parameters)
    scales = {name: scale for name, scale in model.task.scales.items() if name in model.robot.parameters}
    robot = replace(model.robot, base=spatial.inverse(setup.places[CAMERA]) @ setup.base, tool=setup.tool)
    return build_model(robot, Task.of("position", ("base", "tool"), points, fix=fix, scales=scales))


def _sigma(data: Dataset) -> Array:
    return np.full(data.z.shape, np.nan) if data.sigma is None else data.sigma
