"""A robot as a URDF file: the placements between its joints, in metres."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET  # written here, never parsed
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.export.carries import LeftOut, check_carries
from symcal.export.gate import check_exportable
from symcal.export.proof import link_poses
from symcal.outputs.whole_file import write_whole
from symcal.robot.conventions import placements
from symcal.robot.robot import Joint, Robot

Array = NDArray[np.float64]

_M = 1e-3  # metres per mm
_UNKNOWN = "1000000.0"  # URDF wants an effort and a velocity; a robot file may not know them


def save_urdf(
    robot: Robot, path: Path | str, *, world: bool = False, approximate: bool = False, force: bool = False
) -> LeftOut | None:
    """Write a robot with its present (calibrated) numbers as URDF; see `urdf_text`.

    Args:
        force: whether also a calibration that was refused or never judged (`symcal.export.gate`).
    Returns:
        what was left out of its joint terms, None where nothing was.
    Raises:
        RefusedError: as `urdf_text`; the calibration was refused. InputError: the file cannot be written.

    Example:
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/ur5.yaml")
        >>> sc.save_urdf(robot, "robot.urdf")
    """
    check_exportable(robot, force)
    left = check_carries(robot, "urdf", approximate)
    text = text_of(robot if left is None else left.robot, left, world)
    write_whole(path, text)
    return left


def urdf_text(robot: Robot, *, world: bool = False, approximate: bool = False) -> str:
    """URDF of a robot: `base_link`, one link per joint, `tool`; joint positions are the robot's readings (mm as m).

    Signs become the direction of the axis, joint offsets part of the origin. With ``world`` the file starts at the
    instrument's frame, `world`. Masses are not written.

    Args:
        approximate: whether a robot with joint terms is written without them, and the file says what that costs.
    Raises:
        RefusedError: it has joint terms that act and ``approximate`` is False; a joint has a ratio other than 1 (a URDF
            position is the joint's own coordinate: it has no gear), or is prismatic without limits (URDF demands
            them); it has a remainder.
    """
    left = check_carries(robot, "urdf", approximate)
    return text_of(robot if left is None else left.robot, left, world)


def urdf_poses(folder: Path, q: Array, robot: Robot, file: str = "robot.urdf") -> Array:
    """T_base_tool of a URDF that was written of a robot, by yourdfpy; shape (n, 4, 4), mm.

    Args:
        q: readings, rad and mm, shape (n, dof).
    """
    positions = {joint.name: q[:, i] * (1.0 if joint.revolute else _M) for i, joint in enumerate(robot.joints)}
    return link_poses(folder / file, positions, "tool", "base_link")


def text_of(robot: Robot, left: LeftOut | None, world: bool = False) -> str:
    """The URDF of a robot whose joint terms are dealt with: ``left`` says how, in a comment."""
    for name in (robot.name, *(joint.name for joint in robot.joints)):
        if not name.isprintable():
            raise RefusedError(f"the name {name!r} holds characters that XML cannot: give it another in the robot file")
    for joint in robot.joints:
        if joint.ratio != 1:
            raise RefusedError(
                f"joint {joint.name} has ratio {joint.ratio:g}: a URDF joint has none; "
                "give readings in joint coordinates and ratio 1"
            )
        if not joint.revolute and not math.isfinite(joint.upper):
            raise RefusedError(
                f"joint {joint.name} is prismatic without limits, which URDF demands: give 'limits' in the robot file"
            )
    root = ET.Element("robot", name=robot.name)
    calibrated = "calibrated" if robot.record is not None else "nominal"
    root.append(
        ET.Comment(f" {calibrated} kinematics written by symcal; an effort or velocity of {_UNKNOWN} means: not known ")
    )
    if left is not None:
        root.append(ET.Comment(f" {re.sub('-(?=-)', '- ', left.text)} "))  # a comment cannot hold two hyphens in a row
    constant = placements(robot)
    joints = {joint.name for joint in robot.joints}
    links = ["base_link", *(_free(f"{joint.name}_link", {"base_link"}) for joint in robot.joints), "tool"]
    if world:
        ET.SubElement(root, "link", name="world")
    for link in links:
        ET.SubElement(root, "link", name=link)
    if world:
        _connect(root, _free("world_to_base", joints), "fixed", "world", "base_link", robot.base)
    for joint, placement, parent, child in zip(robot.joints, constant, links, links[1:], strict=False):
        _moving(_connect(root, joint.name, _kind(joint), parent, child, placement), joint)
    _connect(root, _free("flange_to_tool", joints), "fixed", links[-2], "tool", constant[-1])
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _free(name: str, taken: set[str]) -> str:
    """The name, with as many underscores behind it as it takes to be new."""
    while name in taken:
        name += "_"
    return name


def _kind(joint: Joint) -> str:
    if not joint.revolute:
        return "prismatic"
    return "revolute" if math.isfinite(joint.upper) else "continuous"


def _connect(root: ET.Element, name: str, kind: str, parent: str, child: str, placement: Array) -> ET.Element:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "origin", xyz=_text(placement[:3, 3] * _M), rpy=_text(roll_pitch_yaw(placement[:3, :3])))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def _moving(element: ET.Element, joint: Joint) -> None:
    ET.SubElement(element, "axis", xyz=_text(np.array([0.0, 0.0, float(joint.sign)])))
    unit = 1.0 if joint.revolute else _M
    speed = _UNKNOWN if joint.speed is None else repr(joint.speed * unit)
    limits = {"effort": _UNKNOWN, "velocity": speed}
    if _kind(joint) != "continuous":
        limits = {"lower": repr(joint.lower * unit), "upper": repr(joint.upper * unit)} | limits
    ET.SubElement(element, "limit", limits)


def roll_pitch_yaw(matrix: Array) -> Array:
    """Angles with Rz(yaw) Ry(pitch) Rx(roll) = R to rounding, in gimbal lock and near it too; shape (3,), rad.

    Roll and pitch are taken from Rz(-yaw) R, so that a yaw made of rounding errors costs nothing.
    """
    yaw = math.atan2(matrix[1, 0], matrix[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-matrix[2, 0], c * matrix[0, 0] + s * matrix[1, 0])
    roll = math.atan2(s * matrix[0, 2] - c * matrix[1, 2], c * matrix[1, 1] - s * matrix[0, 1])
    return np.array([roll, pitch, yaw])


def _text(values: Array) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)
