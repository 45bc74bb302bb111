"""The measurements of an experiment: simulated, or read from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from symcal.calibration.simulate import Noise, concatenate, simulate
from symcal.compensation.handover import true_robot
from symcal.config import conversion as config
from symcal.config.conversion import ExperimentFile, FileData, SimulatedData
from symcal.data.dataset import Dataset, with_random_test
from symcal.data.measurement_file import load_measurements
from symcal.documents.document import Document
from symcal.errors import InputError
from symcal.model.model import Model
from symcal.planning.drive_plan import Planned
from symcal.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class MeasuredData:
    """The measurements of a run, and the files read.

    Of simulated ones also the true robot, and the test poses, if any, without noise.
    """

    data: Dataset
    inputs: tuple[Path, ...] = ()
    truth: Robot | None = None
    exact: Dataset | None = None


def measurements(
    file: ExperimentFile,
    document: Document,
    model: Model,
    rng: np.random.Generator,
    *,
    data: Path | None = None,
    planned: Planned | None = None,
) -> MeasuredData:
    """The measurements of an experiment, simulated or read.

    Args:
        data: a file instead of the experiment's. planned: poses that simulated data train at, instead of random ones.
    Raises:
        InputError: there are none, or they cannot be read.
    """
    source = file.data
    if source is None and data is None:
        message = "there is nothing to identify from: give 'data' here, or measurements with --data"
        raise InputError(message, file=document.path, key="data")
    if isinstance(source, SimulatedData) and data is None:
        lower, upper = config.area_of(file, document, model.robot)
        units = dict(zip(model.parameters.names, model.parameters.units, strict=True))
        truth = config.truth_of(source, file, document, dict(units), rng)
        noise = Noise(
            source.noise.distribution,
            source.noise.position * file.units.factor("mm"),
            source.noise.orientation * file.units.factor("rad"),
        )
        random = rng.uniform(lower, upper, (file.plan.poses, len(lower)))
        train = simulate(model, truth, random if planned is None else planned.plan.poses, noise, rng)
        robot = true_robot(model, truth)
        if not source.test_poses:
            return MeasuredData(train, truth=robot)
        q = rng.uniform(lower, upper, (source.test_poses, len(lower)))
        test = simulate(model, truth, q, noise, rng, "test")
        exact = simulate(model, truth, q, Noise(), rng, "test")
        return MeasuredData(concatenate(train, test), truth=robot, exact=exact)
    read = source if isinstance(source, FileData) else FileData(source="file", file=str(data))
    path = data or config.existing(document, read.file, ("data", "file"), "file of measurements")
    measured = load_measurements(
        path,
        model.robot,
        model.task.kind,
        point_names=model.task.point_names,
        columns=read.columns,
        split=config.split_of(read.split),
        delimiter=read.delimiter,
        decimal=read.decimal,
    )
    if read.split.test_fraction is not None:
        measured = with_random_test(measured, read.split.test_fraction, rng)
    return MeasuredData(measured, (path,))
