"""An experiment file with everything that it names, read and built."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from symcal.config import conversion as config
from symcal.config.conversion import ExperimentFile
from symcal.documents.document import Document
from symcal.errors import InputError
from symcal.fit.options import Options
from symcal.model.model import Model, build_model
from symcal.robot.files import load_robot
from symcal.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Experiment:
    """An experiment file with everything that it names, checked and in mm and rad."""

    file: ExperimentFile
    document: Document
    robot_path: Path
    robot: Robot
    model: Model
    options: Options
    seed: int


def load(path: Path, *, seed: int | None = None, overrides: Sequence[str] = ()) -> Experiment:
    """Read an experiment with its robot and build its model.

    Raises:
        InputError: anything wrong in the files, with its line.
    """
    file, document = config.load_experiment(path, overrides)
    robot_path = config.robot_file_of(file, document)
    robot = load_robot(robot_path)
    model = build_model(robot, config.task_of(file, document, robot))
    options = config.options_of(file, model.measurement)
    return Experiment(file, document, robot_path, robot, model, options, file.seed if seed is None else seed)


def named_files(experiment: Experiment, data: Path | None = None) -> tuple[Path, ...]:
    """The files and folders that a run reads: the experiment, whatever it names, and data given instead of its own."""
    named = config.named_paths(experiment.file, experiment.document)
    return (experiment.document.path, experiment.robot_path, *named, *([] if data is None else [data]))


def robot_of_plan(plan: Path, robot: Path | None = None) -> tuple[Path, Robot]:
    """The poses of a plan and the robot that they are for.

    Args:
        plan: the folder that planning wrote, or a file of poses. robot: of poses that stand alone; otherwise it is that
            of `experiment.resolved.yaml` beside them.
    Raises:
        InputError: there is no robot, or no such plan.
    """
    poses = plan / "plan.csv" if plan.is_dir() else plan
    if robot is not None:
        return poses, load_robot(robot)
    beside = poses.parent / "experiment.resolved.yaml"
    if not poses.is_file():
        raise InputError("there is no plan: expected the folder that 'symcal plan' wrote, or a plan.csv", file=poses)
    if not beside.is_file():
        raise InputError(
            "no experiment.resolved.yaml stands beside it: say whose poses these are", file=poses, key="--robot"
        )
    file, document = config.load_experiment(beside, ())
    return poses, load_robot(config.existing(document, file.robot, ("robot",), "robot file"))
