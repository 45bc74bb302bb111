"""Rows of poses with a bound of their rounding error, by running error analysis ([Higham2002] sec. 3.3).

Every operation is done as the processor does it, and beside each number goes how far it may be from the number that
exact arithmetic would have given: for z = a op b, what the errors of a and b make of it, and at most u |z| of its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.kernels.instructions import Constant, Load, Operation, Program, Store

Array = NDArray[np.float64]

UNIT = 2.0**-53
"""u, half the distance of 1 to the next number."""

_SINE = 8 * UNIT  # absolute error of sin and cos, of arguments up to some turns; libraries have an eighth of that
_READING = 8 * UNIT  # of a node: a fifth of a turn, over a gear
_OWN = 1.0 + 1e-9  # the bounds are rounded too


def evaluate(program: Program, poses: Array) -> tuple[Array, Array]:
    """The first output of a program of one input, and bounds of its errors, both of shape (N, rows, cols).

    Args:
        poses: shape (N, dof), taken as within some roundings of those that are meant.
    Raises:
        RefusedError: an operation that no bound is known for; a branch is one of them.
    """
    port = program.outputs[0]
    values, errors = np.zeros((port.size, len(poses))), np.zeros((port.size, len(poses)))
    work: dict[int, tuple[Array, Array]] = {}
    nothing = np.zeros(len(poses))
    for step in program.instructions:
        if isinstance(step, Load):
            given = np.ascontiguousarray(poses[:, step.element])
            work[step.work] = given, _READING * np.abs(given)
        elif isinstance(step, Constant):
            work[step.work] = np.full(len(poses), step.value), nothing
        elif isinstance(step, Store):
            if step.port == 0:
                values[step.element], errors[step.element] = work[step.work]
        else:
            work[step.work] = _operate(step, [work[i] for i in step.args])
    shape = (port.rows, port.cols, len(poses))
    return np.moveaxis(values.reshape(shape), -1, 0), np.moveaxis(errors.reshape(shape), -1, 0) * _OWN


def _operate(step: Operation, args: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    (a, da), (b, db) = args[0], args[-1]
    match step.op:
        case "add":
            z, carried = a + b, da + db
        case "sub":
            z, carried = a - b, da + db
        case "mul":
            z, carried = a * b, np.abs(a) * db + np.abs(b) * da + da * db
        case "sq":
            z, carried = a * a, (2.0 * np.abs(a) + da) * da
        case "twice":
            return a + a, 2.0 * da
        case "neg":
            return -a, da
        case "assign" | "lift":
            return a, da
        case "sin":
            return np.sin(a), da + _SINE
        case "cos":
            return np.cos(a), da + _SINE
        case _:
            raise RefusedError(
                "the information of a pose is no polynomial of the joints' sines and cosines, as with distances, "
                "pixels and contacts"
            )
    return z, (carried + UNIT * np.abs(z)) * _OWN
