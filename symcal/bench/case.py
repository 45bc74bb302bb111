"""One arm as everybody in a contest gets it: the package's model, and the elements that peers start from."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from symcal.bench.arms import random_postures
from symcal.bench.peers.elements import Elements, elements
from symcal.kinematics import function
from symcal.model.model import Model, build_model
from symcal.model.task import Task
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

_DEPENDENT = 1e-8  # of the largest singular value, below which a scaled direction is not seen


@dataclass(frozen=True, slots=True)
class Case:
    """function: (q, x, setup) -> position p, shape (3,), and its slopes J, shape (3, n): the model's own expression."""

    model: Model
    arm: Elements
    function: ca.Function

    @property
    def robot(self) -> Robot:
        return self.model.robot

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters, in the order of x."""
        return self.model.parameters.names

    @property
    def setup(self) -> Array:
        return self.model.setup.vector


def case_of(robot: Robot, point: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Case:
    """Positions of a point in the tool's frame, mm, with known base and tool."""
    model = build_model(robot, Task.of("position", points={"P": point}))
    measurement = model.measurement
    q = ca.SX.sym("q", robot.dof)
    x = ca.SX.sym("x", len(model.parameters))
    setup = ca.SX.sym("setup", len(model.setup.vector))
    outputs = {"p": measurement.predict(q, x, setup), "J": measurement.jacobian(q, x, setup)}
    both = function("position", {"q": q, "x": x, "setup": setup}, outputs)
    return Case(model, elements(robot, model.parameters.names, point), both)


def identifiable(case: Case, rng: np.random.Generator, poses: int = 200) -> tuple[str, ...]:
    """As many parameters as positions of the nominal arm see directions: by pivoted QR of the scaled Jacobian."""
    q = random_postures(case.robot, poses, rng)
    (slopes,) = case.model.jacobian(q, np.zeros(len(case.names)), case.setup)
    scaled = slopes.reshape(-1, len(case.names)) * case.model.parameters.scales
    upper, order = qr(scaled, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(upper))
    rank = int(np.sum(diagonal > _DEPENDENT * diagonal[0]))
    return tuple(case.names[i] for i in sorted(order[:rank]))
