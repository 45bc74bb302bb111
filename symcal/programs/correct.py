"""A controller's program with its targets corrected for the calibrated robot.

A joint target becomes the joints with which the calibrated robot gets where the nominal one was sent. A frame becomes
the pose that the *nominal* kinematics has with those joints: the controller's own inverse then finds them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.compensation.compensate import Compensation, compensate
from symcal.compensation.targets import POSE_JOINTS, commanded, tool_poses, wanted
from symcal.errors import InputError
from symcal.programs.grammars import GRAMMARS, SUFFIXES
from symcal.programs.literals import Left, Literal, find_literals, line_of
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

_STARTS = 64
"""Random postures from which the postures of a frame are searched for."""
_SAME_MM, _SAME_RAD = 1e-2, 1e-5
"""Corrections of two postures that are the same for any purpose."""
_LARGEST = 4_000_000  # letters of a program
_ASK = "a frame: say '--frame base' if it is one of this robot's tool in its base frame"


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """A program with its targets corrected.

    count: of them. left: targets that are as they were, with the reasons. largest_mm: the largest distance between the
    places to which the calibrated robot goes with and without corrections. result: of the compensation, target by
    target; None where there was nothing to correct.
    """

    text: str
    count: int
    left: tuple[Left, ...]
    largest_mm: float
    result: Compensation | None


def correct_program(path: Path, robot: Robot, rng: np.random.Generator, *, frames: bool = False) -> Corrected:
    """Read a program and correct its targets; `symcal.programs.literals` says which.

    Args:
        frames: whether its frames are poses of the robot's nominal tool in its base frame; they are left where that is
            not said. A frame is corrected where all postures that it allows ask for the same correction.
    Raises:
        InputError: no program in one of the languages; a target outside the limits of a joint.
    """
    language = SUFFIXES.get(path.suffix.lower())
    if language is None:
        raise InputError("not the name of a program", file=path, found=path.suffix, allowed=SUFFIXES)
    text = _read(path)
    found = find_literals(text, GRAMMARS[language])
    left, chosen, joints = list(found.left), list[Literal](), list[Array]()
    for literal in found.literals:
        q = _joints(robot, literal, language, rng, frames, text, path)
        if isinstance(q, Left):
            left.append(q)
            continue
        chosen.append(literal)
        joints.append(q)
    if not chosen:
        return Corrected(text, 0, _in_order(left), 0.0, None)
    result = compensate(robot, commanded(robot, np.array(joints)), rng)
    poses = tool_poses(robot.nominal(), result.joints)
    parts, at = [], 0
    for literal, q, pose in zip(chosen, result.joints, poses, strict=True):
        values = _written(literal, language, q, pose)
        parts += [text[at : literal.start], values]
        at = literal.end
    moved = float(result.uncompensated_mm.max())
    return Corrected("".join([*parts, text[at:]]), len(chosen), _in_order(left), moved, result)


def _joints(
    robot: Robot, literal: Literal, language: str, rng: np.random.Generator, frames: bool, text: str, path: Path
) -> Array | Left:
    """The nominal readings that a target asks for, or why it is left."""
    line = line_of(text, literal.start)
    if literal.kind == "joints":
        if not all(joint.revolute for joint in robot.joints) or robot.dof > 6:
            return Left(line, literal.text, f"{robot.name} is not an arm of up to six revolute joints")
        q = np.array(literal.values[: robot.dof])
        q = q if language == "urscript" else np.radians(q)
        for i, joint in enumerate(robot.joints):
            if not joint.lower - 1e-9 <= q[i] <= joint.upper + 1e-9:
                limits = f"{np.degrees(joint.lower):.6g} to {np.degrees(joint.upper):.6g} deg"
                message = f"joint {joint.name} is outside its limits, {limits}"
                raise InputError(message, file=path, line=line, found=f"{np.degrees(q[i]):.6g} deg")
        return np.asarray(np.clip(q, robot.lower, robot.upper))
    if not frames:
        return Left(line, literal.text, _ASK)
    if robot.dof < POSE_JOINTS:
        return Left(line, literal.text, f"a frame, and {robot.name} has {robot.dof} joints")
    pose = _pose(literal, language)
    if pose is None:
        return Left(line, literal.text, "its quaternion is not of unit length")
    postures, corrected = _postures(robot, pose, literal, rng)
    if not len(postures):
        return Left(line, literal.text, "the nominal robot gets there in no posture that the target allows")
    poses = tool_poses(robot.nominal(), corrected)
    apart = float(np.linalg.norm(poses[:, :3, 3] - poses[0, :3, 3], axis=-1).max())
    turned = float(np.linalg.norm(spatial.matrix_vectors(poses[:, :3, :3] @ poses[0, :3, :3].T), axis=-1).max())
    if apart > _SAME_MM or turned > _SAME_RAD:
        why = f"{len(postures)} postures fit it, whose corrections are up to {apart:.3g} mm apart: give its joints"
        return Left(line, literal.text, why)
    return np.asarray(postures[0])


def _postures(robot: Robot, pose: Array, literal: Literal, rng: np.random.Generator) -> tuple[Array, Array]:
    """Readings with which the nominal robot is at a pose, as many as are found and allowed, and the corrected ones;
    shape (n, dof)."""
    starts = rng.uniform(*robot.ranges, (_STARTS, robot.dof))
    result = compensate(robot, wanted(robot, np.tile(pose, (_STARTS, 1, 1)), joints=starts), rng)
    kept: list[int] = []
    for i, status in enumerate(result.status):
        degrees = np.degrees(result.nominal[i])
        fits = all(low - 1e-6 <= degrees[axis] <= high + 1e-6 for axis, (low, high) in literal.posture.items())
        new = all(np.abs(result.nominal[i] - result.nominal[k]).max() > 1e-4 for k in kept)
        if status != "out of reach" and fits and new:
            kept.append(i)
    return result.nominal[kept], result.joints[kept]


def _pose(literal: Literal, language: str) -> Array | None:
    """T_base_tool of a frame, (4, 4), mm."""
    xyz, rest = np.array(literal.values[:3]), np.array(literal.values[3:])
    if language == "urscript":
        return spatial.transform(spatial.vector_matrix(rest), xyz * 1e3)
    if language == "krl":
        return spatial.transform(spatial.rpy_matrix(np.radians(rest[::-1])), xyz)
    if abs(np.linalg.norm(rest) - 1) > 1e-3:
        return None
    return spatial.transform(spatial.quaternion_matrices(rest[[1, 2, 3, 0]]), xyz)


def _written(literal: Literal, language: str, q: Array, pose: Array) -> str:
    """The numbers of a target as its language writes them, in the place of those that stood there."""
    if literal.kind == "joints":
        own = q if language == "urscript" else np.degrees(q)
        values = [*own.tolist(), *literal.values[len(own) :]]
        if language == "krl":
            return ", ".join(f"A{i} {value:.6f}" for i, value in enumerate(values, start=1))
        return ", ".join(f"{value:.9f}" if language == "urscript" else f"{value:.6f}" for value in values)
    xyz, turn = pose[:3, 3], pose[:3, :3]
    if language == "urscript":
        return ", ".join(f"{value:.9f}" for value in (*(xyz * 1e-3), *spatial.matrix_vectors(turn)))
    if language == "krl":
        angles = np.degrees(spatial.matrix_rpy(turn))[::-1]
        return ", ".join(f"{n} {v:.6f}" for n, v in zip("XYZABC", (*xyz, *angles), strict=True))
    x, y, z, w = spatial.matrix_quaternions(turn)
    quaternion = np.array([w, x, y, z])
    given = np.array(literal.values[3:])
    quaternion = quaternion if quaternion @ given >= 0 else -quaternion  # as it was written
    return f"{', '.join(f'{v:.6f}' for v in xyz)}], [{', '.join(f'{v:.9f}' for v in quaternion)}"


def _in_order(left: Sequence[Left]) -> tuple[Left, ...]:
    return tuple(sorted(left, key=lambda each: each.line))


def _read(path: Path) -> str:
    try:
        text = path.read_bytes()
    except OSError as error:
        raise InputError(f"the program cannot be read: {error.strerror}", file=path) from None
    if len(text) > _LARGEST:
        raise InputError("the program is too long", file=path, found=f"{len(text)} bytes", allowed=[f"{_LARGEST}"])
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")  # what RAPID and KRL are written in
