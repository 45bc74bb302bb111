"""Simulation II of [Ding2017]: identification from noisy positions, judged at test poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.calibrate import baseline_model, calibrate
from symcal.calibration.simulate import simulate
from symcal.config.study import SimulationOneConfig
from symcal.data.dataset import Dataset
from symcal.fit.estimation import Options
from symcal.paper import published
from symcal.paper.repetitions import cramer_rao
from symcal.paper.results import Identified, Setting, StudyPlan
from symcal.paper.setting import positions
from symcal.solvers import levenberg_marquardt
from symcal.solvers.least_squares import Problem, Tolerances

Array = NDArray[np.float64]


def simulation_2(
    setting: Setting,
    plans: Mapping[str, StudyPlan],
    options: Options,
    solver: SimulationOneConfig,
    rng: np.random.Generator,
) -> tuple[Mapping[str, Identified], Mapping[str, Dataset], Dataset]:
    """Measure and identify once on every plan; all are judged against the same noisy test data.

    Args:
        options: of the identification; its known noise is set to that of the simulation, its sizes hold as stated.
        solver: the paper's.
    Returns:
        what was found, and what was measured, by plan; and the noisy test data.
    """
    model = setting.model
    for_test, *for_plans = rng.spawn(1 + len(plans))
    options = Options(options.solver, options.tolerances, options.loss, {"position": setting.sigma}, "stated")
    baseline = baseline_model(model)
    truth = model.parameters.mapping(setting.truth)
    noise = setting.noise.draw(setting.noise.sizes["position"], setting.test_positions.shape, for_test)
    measured = setting.test_positions + noise
    found, data = {}, {}
    for (name, plan), own in zip(plans.items(), for_plans, strict=True):
        data[name] = simulate(model, truth, plan.poses, setting.noise, own)
        calibration = calibrate(model, baseline, data[name], options)
        free = unregularised(setting, plan.poses, data[name].z, solver)
        after = positions(setting, setting.test_poses, calibration.after.x)
        found[name] = Identified(
            plan=name,
            calibration=calibration,
            unregularised=free,
            before_measured=_norms(setting.nominal_positions - measured),
            after_measured=_norms(after - measured),
            after_true=_norms(after - setting.test_positions),
            unregularised_true=true_errors(setting, free),
            cramer_rao_mm=float(cramer_rao(setting, plan.poses)),
        )
    poses = setting.test_poses
    labels = tuple(f"test {i + 1}" for i in range(len(poses)))
    first = next(iter(data.values()))
    test = replace(first, q=poses, z=measured, labels=labels, split=("test",) * len(poses))
    return found, data, test


def _norms(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def true_errors(setting: Setting, x: Array) -> Array:
    """Errors against truth at the test poses, shape (T,), mm, of the robot with errors x."""
    return _norms(positions(setting, setting.test_poses, x) - setting.test_positions)


def published_errors(setting: Setting) -> Mapping[str, Array]:
    """Errors against truth at our test poses of the robots that the paper identified, shape (T,), mm; where the true
    errors are not the paper's, there is nothing to compare with."""
    names = setting.model.parameters.names
    if set(names) != set(published.TABLE_III):
        return {}
    truth = setting.model.parameters.vector(published.TABLE_III)
    if not np.allclose(truth, setting.truth, rtol=0, atol=1e-12):
        return {}
    return {key: true_errors(setting, setting.model.parameters.vector(t)) for key, t in published.TABLES.items()}


def unregularised(setting: Setting, poses: Array, z: Array, config: SimulationOneConfig) -> Array:
    """All parameters free and nothing to hold what the data do not see, by the paper's algorithm: errors, shape (n,).

    Along the unseen directions it is still on its way when the largest number of iterations stops it.
    Source: [Ding2017] section V, eq. 13.
    """
    model = setting.model

    def evaluate(x: Array) -> tuple[Array, Array]:
        residual, jacobian = model.residual(poses, x, model.setup.vector, z)
        return residual.ravel(), jacobian.reshape(-1, len(x))

    problem = Problem(evaluate, np.full(len(setting.truth), config.start), np.ones(len(setting.truth)))
    tolerances = Tolerances(gradient=0.0, cost=1e-12, step=0.0, iterations=config.iterations)
    return levenberg_marquardt(problem, tolerances, damping=config.damping, factor=config.factor, scaled=False).x
