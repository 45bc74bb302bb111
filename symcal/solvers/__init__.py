"""Least-squares solvers, one per file; each takes a Problem and gives a Solution."""

from collections.abc import Callable
from typing import Literal

from symcal.solvers.gauss_newton import gauss_newton
from symcal.solvers.ipopt import ipopt
from symcal.solvers.least_squares import Problem, Solution, Tolerances
from symcal.solvers.levenberg_marquardt import levenberg_marquardt

SolverName = Literal["levenberg_marquardt", "gauss_newton", "ipopt"]

SOLVERS: dict[SolverName, Callable[[Problem, Tolerances], Solution]] = {
    "levenberg_marquardt": levenberg_marquardt,
    "gauss_newton": gauss_newton,
    "ipopt": ipopt,
}

__all__ = ["SOLVERS", "SolverName", "gauss_newton", "ipopt", "levenberg_marquardt"]
