"""The loop that Gauss-Newton and Levenberg-Marquardt share: try steps until one lowers the cost enough, and go on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from symcal.solvers.least_squares import (
    Array,
    Iterate,
    Problem,
    Solution,
    Status,
    Tolerances,
    cost_of,
    iterate,
    stop_reason,
)


@dataclass(frozen=True, slots=True)
class Trial:
    """A step to try, in scaled unknowns. size: its damping or length. enough: the largest cost that accepts it."""

    step: Array
    size: float
    enough: float


@dataclass(frozen=True, slots=True)
class Stop:
    """No step is worth trying any more."""

    status: Status
    detail: str


Proposals = Callable[[Array, Array, Sequence[Iterate]], Iterator[Trial | Stop]]
"""Scaled Jacobian, residual and history -> steps to try in turn; a Stop, which ends the solver, comes last."""


def descend(
    problem: Problem, tolerances: Tolerances, propose: Proposals, *, solver: str, width: Array, first: float
) -> Solution:
    """Minimise by the steps that ``propose`` gives.

    Args:
        width: D^-1, shape (n,): unknowns are scaled by it. first: size in the history's first entry.
    """
    x = problem.start.astype(float)
    residual, jacobian = problem.evaluate(x)
    evaluations = 1
    history = [iterate(x, residual, jacobian, width, 0.0, first)]

    def finish(status: Status, detail: str) -> Solution:
        return Solution(x, cost_of(residual), residual, jacobian, status, detail, solver, evaluations, tuple(history))

    if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
        return finish(Status.FAILED, "at the first guess")
    reason = stop_reason(history[0], history[0], problem.counted(residual), tolerances)
    while reason is None:
        if len(history) > tolerances.iterations:
            return finish(Status.ITERATIONS, f"{tolerances.iterations}")
        for trial in propose(jacobian * width, residual, history):
            if isinstance(trial, Stop):
                return finish(trial.status, trial.detail)
            at = x + width * trial.step
            new_residual, new_jacobian = problem.evaluate(at)
            evaluations += 1
            if cost_of(new_residual) <= trial.enough and np.isfinite(new_jacobian).all():
                x, residual, jacobian = at, new_residual, new_jacobian
                length = float(np.linalg.norm(trial.step))
                history.append(iterate(x, residual, jacobian, width, length, trial.size))
                break
        reason = stop_reason(history[-2], history[-1], problem.counted(residual), tolerances)
    return finish(*reason)
