"""Nonlinear least squares as data: a Problem goes in, a Solution comes out. Vectors only; knows no robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Problem:
    """Minimise 0.5 * |r(x)|^2.

    evaluate: x (n,) -> r (m,) and J (m, n), already whitened; or fewer rows with the same squared norms, such as a
        triangle. start: first guess, shape (n,).
    scales: plausible size of each unknown, shape (n,): the fixed matrix D^-1 of the damping. equations: how many rows
        those of ``evaluate`` stand for; themselves when None.
    """

    evaluate: Callable[[Array], tuple[Array, Array]]
    start: Array
    scales: Array
    equations: int | None = None

    def counted(self, residual: Array) -> int:
        """How many equations a residual stands for."""
        return residual.size if self.equations is None else self.equations


class Status(Enum):
    """Why a solver stopped."""

    GRADIENT = "converged: the gradient is zero to the tolerance"
    COST = "converged: the cost no longer changes"
    STEP = "converged: the step is below the tolerance"
    TARGET = "converged: the residual is below its target"
    STALLED = "converged: no step lowers the cost any further (limit of rounding)"
    ITERATIONS = "stopped: the largest number of iterations was reached before convergence"
    FAILED = "failed: the model gave no finite number"

    @property
    def converged(self) -> bool:
        return self not in (Status.ITERATIONS, Status.FAILED)


@dataclass(frozen=True, slots=True)
class Iterate:
    """One row of the history: the start, or the state after an accepted step.

    cost: 0.5 * |r|^2. gradient: largest component of the scaled gradient. step: norm of the scaled step that led here.
    damping: lambda of that step, or the step length of a line search; 0 where a method has none.
    """

    cost: float
    gradient: float
    step: float
    damping: float
    x: Array


@dataclass(frozen=True, slots=True)
class Solution:
    """Result of a solver. iterations counts accepted steps; history starts with the initial guess."""

    x: Array
    cost: float
    residual: Array
    jacobian: Array
    status: Status
    detail: str
    solver: str
    evaluations: int
    history: tuple[Iterate, ...] = field(repr=False)

    @property
    def iterations(self) -> int:
        return len(self.history) - 1

    @property
    def message(self) -> str:
        """Why the solver stopped, in a sentence."""
        return f"{self.status.value}{f' ({self.detail})' if self.detail else ''}"


@dataclass(frozen=True, slots=True)
class Tolerances:
    """When a solver stops.

    gradient: largest scaled gradient, relative to 1 + cost. cost: relative change of the cost by a step.
    step: norm of the scaled step. residual: root mean square of the residual that is good enough (0: never).
    iterations: largest number of accepted steps.
    """

    gradient: float = 1e-10
    cost: float = 1e-14
    step: float = 1e-12
    residual: float = 0.0
    iterations: int = 100


def cost_of(residual: Array) -> float:
    return 0.5 * float(residual @ residual)


def iterate(x: Array, residual: Array, jacobian: Array, scales: Array, step: float, damping: float) -> Iterate:
    gradient = float(np.max(np.abs(scales * (jacobian.T @ residual)), initial=0.0))
    return Iterate(cost_of(residual), gradient, step, damping, x.copy())


def stop_reason(previous: Iterate, current: Iterate, rows: int, tolerances: Tolerances) -> tuple[Status, str] | None:
    """The convergence test that all solvers share; None to go on."""
    rms = np.sqrt(2 * current.cost / max(rows, 1))
    if rms < tolerances.residual:
        return Status.TARGET, f"rms {rms:.2g} < {tolerances.residual:.2g}"
    if current.gradient <= tolerances.gradient * (1 + current.cost):
        return Status.GRADIENT, f"largest scaled gradient {current.gradient:.2g}"
    if previous is not current:
        if previous.cost - current.cost <= tolerances.cost * previous.cost:
            return Status.COST, f"relative change {(previous.cost - current.cost) / (previous.cost or 1.0):.2g}"
        if current.step <= tolerances.step:
            return Status.STEP, f"scaled step {current.step:.2g}"
    return None
