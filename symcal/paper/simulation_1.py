"""Simulation I of [Ding2017]: all fifteen errors from exact positions, by the paper's Levenberg-Marquardt."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from symcal.config.study import SimulationOneConfig
from symcal.paper.mirror import canonical
from symcal.paper.results import Recovery, Setting, SimulationOne, StudyPlan
from symcal.paper.setting import positions
from symcal.solvers import levenberg_marquardt
from symcal.solvers.least_squares import Problem, Tolerances

Array = NDArray[np.float64]


def simulation_1(
    setting: Setting, plans: Mapping[str, StudyPlan], config: SimulationOneConfig, rng: np.random.Generator
) -> SimulationOne:
    """Recover the true errors on every plan, and on random plans to see that it was no luck."""
    found = {name: recover(setting, name, plan.poses, config) for name, plan in plans.items()}
    draws, mirrors = [], 0
    for i in range(config.draws):
        poses = setting.info.area.sample(rng, setting.count)
        one = recover(setting, f"random {i + 1}", poses, config)
        draws.append((one.iterations, one.position_error_mm[-1], np.abs(one.found - setting.truth).max()))
        mirrors += one.mirrored
    return SimulationOne(found[config.plan], found, np.array(draws, dtype=np.float64).reshape(-1, 3), mirrors)


def recover(setting: Setting, name: str, poses: Array, config: SimulationOneConfig) -> Recovery:
    """One run: eq. 13 with D = I from the paper's start, without noise.

    Source: [Ding2017] section V.
    """
    model = setting.model
    exact = positions(setting, poses, setting.truth)

    def evaluate(x: Array) -> tuple[Array, Array]:
        residual, jacobian = model.residual(poses, x, model.setup.vector, exact)
        return residual.ravel(), jacobian.reshape(-1, len(x))

    problem = Problem(evaluate, np.full(len(setting.truth), config.start), np.ones(len(setting.truth)))
    # the mean of norms is at most sqrt(3) times the rms of components: this stops once the paper's test is met
    tolerances = Tolerances(
        gradient=0.0, cost=0.0, step=0.0, residual=config.position_error / np.sqrt(3), iterations=config.iterations
    )
    solution = levenberg_marquardt(problem, tolerances, damping=config.damping, factor=config.factor, scaled=False)
    errors = [np.linalg.norm(positions(setting, poses, it.x) - exact, axis=1).mean() for it in solution.history]
    met = np.flatnonzero(np.array(errors) < config.position_error)
    last = int(met[0]) if met.size else len(errors) - 1
    found, mirrored = canonical(solution.history[last].x, model.parameters, model.robot.dof)
    return Recovery(
        plan=name,
        iterations=last,
        position_error_mm=np.array(errors[: last + 1]),
        damping=np.array([it.damping for it in solution.history[: last + 1]]),
        found=found,
        mirrored=mirrored,
        message=solution.message,
    )
