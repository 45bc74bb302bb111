"""The straight-line programs of an exported robot, all in the base frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np

from symcal.compensation.compensate import compensation_step
from symcal.compensation.targets import POSE_JOINTS, base_chain, base_frames
from symcal.errors import RefusedError
from symcal.kernels.instructions import Constant, Instruction, Program, read_program
from symcal.kinematics import chain, function, omegas, stack
from symcal.model.parameter_set import parameter_set
from symcal.robot.robot import Robot

SX = ca.SX

_SMALLEST, _LARGEST = 2.0**-126, 3.4e38  # what a float holds without loss; smaller constants are rounding errors
_ROUNDING = 2.0**-50  # of an element of a rotation matrix that was made of angles


def tidy(robot: Robot) -> Robot:
    """The robot with the rounding errors of its tool's axes removed: no operations are spent on them."""
    tool = robot.tool.copy()
    tool[:3, :3][np.abs(tool[:3, :3]) < _ROUNDING] = 0.0
    return replace(robot, tool=tool)


def programs(robot: Robot) -> Mapping[str, Program]:
    """Name -> program; inputs are called as the arguments in the C source.

    forward, forward_nominal, jacobian (q); forward_with, jacobian_with (q, x, base, tool): poses [R | p], shape
    (3, 4), and Jacobians, shape (6, dof). target_position: p of the nominal robot (q). step_position,
    step_position_with, and step_pose, step_pose_with for arms with six joints or more: see `compensation_step`;
    miss_position and so on are their error alone.

    Raises:
        RefusedError: a number of the robot is too large for a float.
    """
    robot, nominal = tidy(robot), tidy(robot.nominal())
    found = {
        "forward": _fixed(robot, "pose"),
        "forward_nominal": _fixed(nominal, "pose"),
        "jacobian": _fixed(robot, "jacobian"),
        "forward_with": _given(nominal, "pose"),
        "jacobian_with": _given(nominal, "jacobian"),
        "target_position": _fixed(nominal, "position"),
        "step_position": compensation_step(robot),
        "step_position_with": compensation_step(nominal, adjustable=True),
    }
    if robot.dof >= POSE_JOINTS:
        found["step_pose"] = compensation_step(robot, pose=True)
        found["step_pose_with"] = compensation_step(nominal, pose=True, adjustable=True)
    found |= {name.replace("step", "miss"): _error(f) for name, f in found.items() if name.startswith("step")}
    return {name: _portable(read_program(f)) for name, f in found.items()}


def _outputs(model_tool: SX, jacobian: SX) -> dict[str, SX]:
    return {"pose": model_tool[:3, :], "position": model_tool[:3, 3], "jacobian": jacobian}


def _fixed(robot: Robot, wanted: str) -> ca.Function:
    """q -> pose, position or jacobian, with the robot's numbers as constants."""
    model = base_chain(robot)
    jacobian = ca.vertcat(stack(model.joint_screws, model.tool[:3, 3]), omegas(model.joint_screws))
    expression = ca.substitute(_outputs(model.tool, jacobian)[wanted], model.frames, base_frames(robot))
    return function(wanted, {"q": model.q}, {wanted: expression})


def _given(nominal: Robot, wanted: str) -> ca.Function:
    """(q, x, base, tool) -> pose or jacobian; x are errors on top of the nominal robot's link parameters."""
    model = chain(nominal, parameter_set(nominal))
    jacobian = ca.vertcat(stack(model.joint_screws, model.tool[:3, 3]), omegas(model.joint_screws))
    base, tool = SX.sym("base", 3, 4), SX.sym("tool", 3, 4)
    frames = ca.vertcat(ca.vec(base), ca.vec(tool))
    expression = ca.substitute(_outputs(model.tool, jacobian)[wanted], model.frames, frames)
    return function(wanted, {"q": model.q, "x": model.x, "base": base, "tool": tool}, {wanted: expression})


def _error(step: ca.Function) -> ca.Function:
    """The error of a compensation step without the step; the bounds are no inputs."""
    inputs = {name: SX.sym(name, *step.size_in(name)) for name in step.name_in()}
    error = step.call(inputs, True, False)["error"]
    kept = {name: value for name, value in inputs.items() if name not in ("lower", "upper")}
    return function("miss", kept, {"error": error})


def _portable(program: Program) -> Program:
    """The same program with constants that a float can hold."""

    def fit(instruction: Instruction) -> Instruction:
        if not isinstance(instruction, Constant):
            return instruction
        return replace(instruction, value=portable(instruction.value))

    return replace(program, instructions=tuple(fit(i) for i in program.instructions))


def portable(value: float) -> float:
    """The number, or zero if it is below a float's range.

    Raises:
        RefusedError: it is above that range.
    """
    if not abs(value) <= _LARGEST:
        raise RefusedError(
            f"the model holds the number {value:g}, which single precision cannot: "
            "is a joint's ratio or a length in another unit than the robot file says?"
        )
    return value if abs(value) >= _SMALLEST else 0.0
