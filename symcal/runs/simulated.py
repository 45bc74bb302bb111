"""The measurements of a simulated experiment: at its plan or at random poses, with truth and noise of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.candidates import terms_named
from symcal.calibration.compensation_check import true_robot
from symcal.calibration.extend import with_terms
from symcal.calibration.simulate import concatenate, simulate
from symcal.config import conversion as config
from symcal.config.conversion import ExperimentFile, SimulatedData
from symcal.documents.document import Document
from symcal.instruments.noise import Noise
from symcal.model.contact import constraints, contact_postures
from symcal.model.model import Model
from symcal.planning.area import WorkingArea, draw
from symcal.planning.constraints import feasible
from symcal.planning.drive_plan import Planned
from symcal.planning.plan_constraints import asked_view
from symcal.planning.visibility import within_limits
from symcal.runs.data import MeasuredData

Array = NDArray[np.float64]


def simulated_data(
    file: ExperimentFile,
    source: SimulatedData,
    document: Document,
    model: Model,
    rng: np.random.Generator,
    planned: Planned | None,
) -> MeasuredData:
    lower, upper = config.area_of(file, document, model.robot)
    true_model = with_terms(model, terms_named(model.robot, source.truth.errors))
    units = dict(zip(true_model.parameters.names, true_model.parameters.units, strict=True))
    truth = config.truth_of(source, file, document, dict(units), rng)
    noise = config.noise_of(file, source, model.task.observations)
    limits = within_limits(model, asked_view(file))
    seen = feasible(limits) if limits else None  # nobody measures where nothing is seen

    def uniform(count: int) -> Array:
        return rng.uniform(lower, upper, (count, len(lower)))

    def anywhere(count: int) -> Array:
        if constraints(model.measurement):
            return contact_postures(model, count, uniform, (lower, upper), seen)
        return uniform(count) if seen is None else draw(WorkingArea(lower, upper), rng, count, seen)

    random = anywhere(file.plan.poses)
    train = simulate(true_model, truth, random if planned is None else planned.plan.poses, noise, rng)
    robot = true_robot(true_model, truth)
    if not source.test_poses:
        return MeasuredData(train, truth=robot)
    q = anywhere(source.test_poses)
    test = simulate(true_model, truth, q, noise, rng, "test")
    exact = simulate(true_model, truth, q, Noise(), rng, "test")
    return MeasuredData(concatenate(train, test), truth=robot, exact=exact)
