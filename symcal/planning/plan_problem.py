"""The section `plan` of an experiment as a planning problem, in mm and rad, with the place of every mistake."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.config import conversion as config
from symcal.config.conversion import ExperimentFile
from symcal.config.plan import AreaRegion, BoxRegion
from symcal.documents.document import Document, Key
from symcal.model.contact import constraints, touched_names
from symcal.model.model import Model
from symcal.planning.area import Feasible, WorkingArea
from symcal.planning.camera_view import CameraView
from symcal.planning.constraints import Constraint, feasible, insist, joint_limits
from symcal.planning.contact_pool import nearest_contacts, touching_pool
from symcal.planning.information import PoseInformation, pose_information
from symcal.planning.nominal_noise import nominal_noise
from symcal.planning.ordering import joint_speeds
from symcal.planning.plan_constraints import asked_view, clearance, own_camera, separate_camera
from symcal.planning.plan_file import read_plan
from symcal.planning.region import TaskRegion, area_region, box_region, csv_region
from symcal.planning.skeleton import Skeleton, skeleton
from symcal.planning.visibility import within_limits
from symcal.planning.worst_pose import feasible_set
from symcal.robot.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PlanProblem:
    """What is to be planned, made by `plan_problem`.

    area: where poses may lie, margins taken off. measuring, moving: constraints on the measured poses, and the ones
    among them that also hold on the way. view: the camera with its target, None without one. required, candidates:
    poses, shape (k, dof), with their names; candidates is None where any pose of the area will do. inputs: files read.
    pool: postures to choose from, shape (K, dof): those that touch what they must, or a sample where the plan is to be
    of one; None where any pose of the area will do.
    start: joint readings where the robot begins, None if not said. speeds: shape (dof,), None if not all are known.
    """

    info: PoseInformation
    area: WorkingArea
    region: TaskRegion
    arm: Skeleton
    view: CameraView | None
    measuring: tuple[Constraint, ...]
    moving: tuple[Constraint, ...]
    required: Array
    required_names: tuple[str, ...]
    candidates: Array | None
    candidate_names: tuple[str, ...]
    pool: Array | None
    start: Array | None
    speeds: Array | None
    inputs: tuple[Path, ...]

    @property
    def choices(self) -> Array | None:
        """The finite set that a plan is chosen from, shape (K, dof); None where any pose of the area will do."""
        return self.pool if self.candidates is None else self.candidates

    @property
    def touches(self) -> Callable[[Array], tuple[str, ...]] | None:
        """What each posture touches, by name; None where nothing is touched."""
        measurement = self.info.measurement
        return partial(touched_names, measurement, self.info.setup) if constraints(measurement) else None

    @property
    def robot(self) -> Robot:
        return self.info.measurement.chain.robot

    @property
    def aligned(self) -> bool:
        """Whether errors are meant after one rigid alignment: the measurement cannot tell where the world is."""
        return self.info.measurement.adrift

    @property
    def feasible(self) -> Feasible | None:
        return feasible(self.measuring) if self.measuring else None


def plan_problem(file: ExperimentFile, document: Document, model: Model, rng: np.random.Generator) -> PlanProblem:
    """Convert and check everything that the plan of an experiment names.

    Raises:
        InputError: with file, line and key. RefusedError: no noise is stated, nothing is feasible, or a required pose
            cannot be measured (named, with the reason).
    """
    plan, robot = file.plan, model.robot
    inputs: list[Path] = []
    sigmas = nominal_noise(file, model)
    area = _area(file, document, robot)
    arm = skeleton(model.measurement.chain, model.setup)
    view = None
    measuring: tuple[Constraint, ...] = ()
    moving = clearance(file, document, arm)
    if plan.constraints.camera is not None:
        view, measuring = separate_camera(plan.constraints.camera, file, document, model, inputs)
    elif model.task.scene is not None:
        view, measuring = own_camera(model.task.scene, file, document, model)
    else:
        measuring = within_limits(model, asked_view(file))
    measuring = (*measuring, *moving)
    mask = feasible(measuring) if measuring else None
    required, required_names = _required(file, document, robot, measuring, inputs)
    candidates, candidate_names = _candidates(file, document, robot, inputs)
    touching = touching_pool(model, area, plan.sample, rng, mask) if constraints(model.measurement) else None
    if touching is not None and candidates is not None:
        candidates = nearest_contacts(model, candidates)
    pool = touching
    if touching is None and plan.among == "sample":
        pool = feasible_set(area, rng, plan.sample, mask).sample
    info = pose_information(
        model.measurement,
        model.setup,
        sigmas,
        (*model.kinematic, *model.placement),
        area=area,
        feasible=mask,
        poses=plan.poses,
        typical=touching,
    )
    return PlanProblem(
        info=info,
        area=area,
        region=_region(file, document, info, mask, rng, inputs),
        arm=arm,
        view=view,
        measuring=measuring,
        moving=moving,
        required=required,
        required_names=required_names,
        candidates=candidates,
        candidate_names=candidate_names,
        pool=pool,
        start=None if plan.start is None else _readings(plan.start, file, document, robot, ("plan", "start")),
        speeds=_speeds(file, document, robot),
        inputs=tuple(inputs),
    )


def _area(file: ExperimentFile, document: Document, robot: Robot) -> WorkingArea:
    lower, upper = config.area_of(file, document, robot)
    margins = file.plan.margins
    for i, joint in enumerate(robot.joints):
        unit = "rad" if joint.revolute else "mm"
        margin = (margins.angle if joint.revolute else margins.length) * file.units.factor(unit)
        lower[i], upper[i] = max(lower[i], joint.lower + margin), min(upper[i], joint.upper - margin)
        if not lower[i] < upper[i]:
            raise document.error("nothing of this joint's range is left", ("plan", "margins"), found=joint.name)
    return WorkingArea(lower, upper)


def _readings(values: Sequence[float], file: ExperimentFile, document: Document, robot: Robot, key: Key) -> Array:
    """Joint readings of the file in rad and mm, within the joint limits."""
    if len(values) != robot.dof:
        names = ", ".join(joint.name for joint in robot.joints)
        raise document.error(f"need {robot.dof} joint readings ({names})", key, found=values)
    units = ["rad" if joint.revolute else "mm" for joint in robot.joints]
    pose = np.array([value * file.units.factor(unit) for value, unit in zip(values, units, strict=True)])
    for joint, reading, given in zip(robot.joints, pose, values, strict=True):
        if not joint.lower - 1e-9 <= reading <= joint.upper + 1e-9:
            raise document.error(f"outside the limits of joint '{joint.name}'", key, found=given)
    return pose


def _speeds(file: ExperimentFile, document: Document, robot: Robot) -> Array | None:
    """Speeds of the plan, else of the robot file; None if a joint has none."""
    names = [joint.name for joint in robot.joints]
    for name in file.plan.speeds:
        if name not in names:
            raise document.error("no such joint", ("plan", "speeds", name), found=name, allowed=names)
    given: list[float] = []
    for joint in robot.joints:
        factor = file.units.factor("rad" if joint.revolute else "mm")
        own = file.plan.speeds.get(joint.name)
        value = joint.speed if own is None else own * factor
        if value is None:
            return None
        given.append(value)
    return joint_speeds(robot, given)


def _region(
    file: ExperimentFile,
    document: Document,
    info: PoseInformation,
    mask: Feasible | None,
    rng: np.random.Generator,
    inputs: list[Path],
) -> TaskRegion:
    wanted, robot = file.plan.region, info.measurement.chain.robot
    if wanted is None:
        return area_region(info.area, rng, feasible=mask)
    if isinstance(wanted, AreaRegion):
        # accuracy may be wanted where nothing can be measured: the constraints of a measurement do not hold here
        own = file.plan.model_copy(update={"area": file.plan.area | wanted.area})
        lower, upper = config.area_of(file.model_copy(update={"plan": own}), document, robot)
        return area_region(WorkingArea(lower, upper), rng)
    if isinstance(wanted, BoxRegion):
        length = file.units.factor("mm")
        return box_region(info, np.array(wanted.lower) * length, np.array(wanted.upper) * length, rng)
    path = config.existing(document, wanted.file, ("plan", "region", "file"), "file of poses")
    inputs.append(path)
    return csv_region(path, robot)


def _required(
    file: ExperimentFile, document: Document, robot: Robot, measuring: Sequence[Constraint], inputs: list[Path]
) -> tuple[Array, tuple[str, ...]]:
    wanted, key = file.plan.required, ("plan", "required")
    if not wanted:
        return np.zeros((0, robot.dof)), ()
    if isinstance(wanted, str):
        path = config.existing(document, wanted, key, "file of required poses")
        inputs.append(path)
        poses, names = read_plan(path, robot)
        names = tuple(f"required {name}" for name in names)
    else:
        poses = np.array(
            [_readings(values, file, document, robot, (*key, i)) for i, values in enumerate(wanted)]
        ).reshape(-1, robot.dof)
        names = tuple(f"required {i + 1}" for i in range(len(poses)))
    margins = file.plan.margins
    limits = joint_limits(
        robot,
        angle_margin=margins.angle * file.units.factor("rad"),
        length_margin=margins.length * file.units.factor("mm"),
    )
    return insist((*limits, *measuring), poses, names), names


def _candidates(
    file: ExperimentFile, document: Document, robot: Robot, inputs: list[Path]
) -> tuple[Array | None, tuple[str, ...]]:
    if file.plan.candidates is None:
        return None, ()
    path = config.existing(document, file.plan.candidates, ("plan", "candidates"), "file of candidates")
    inputs.append(path)
    return read_plan(path, robot)
