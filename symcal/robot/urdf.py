"""Robots from URDF files: the chain of joints between two links, exactly, as a table of link parameters.

Only what moves, and what it weighs, is read: links by name, masses and centres, joints with origin, axis and limits.
Meshes and everything else are passed over.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.errors import InputError
from symcal.robot.conventions import craig_robot
from symcal.robot.robot import Joint, Robot
from symcal.robot.terms import DOWN
from symcal.robot.urdf_masses import carried_masses
from symcal.robot.urdf_xml import MM, Element, name_of, numbers, origin, read_urdf

Array = NDArray[np.float64]

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed")
"""The joint types that a serial chain may have."""


def load_urdf(path: Path | str, base_link: str, tip_link: str) -> Robot:
    """The serial robot between two links of a URDF file, in the `craig` convention (`conventions.craig_robot`).

    T_world_tool of the result is the pose of ``tip_link`` in ``base_link``, with joint readings as URDF defines them
    (in mm where it says m). Joint names, limits and speeds are kept; continuous joints have no limits. Gravity is
    along -z of ``base_link``; masses (`urdf_masses`) act only where a compliance is given.

    Raises:
        InputError: not a URDF file, no such link, no chain of revolute, continuous, prismatic and fixed joints from
            base to tip, or a joint or a mass that cannot be read; with its line.

    Example:
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/ur5.yaml")
        >>> sc.save_urdf(robot, "robot.urdf")
        >>> again = sc.load_urdf("robot.urdf", "base_link", "tool")
        >>> again.dof, again.convention
        (6, 'craig')
    """
    path = Path(path)
    root = read_urdf(path)
    links = {child.attributes.get("name", "") for child in root.children if child.tag == "link"}
    for role, link in (("base", base_link), ("tip", tip_link)):
        if link not in links:
            raise InputError(
                f"the file has no link of this name (as {role})", file=path, found=link, allowed=sorted(links)
            )
    joints: list[Joint] = []
    placements = [np.eye(4)]
    way = _path(path, root, base_link, tip_link)
    for element in way:
        kind = _kind(path, element)
        placements[-1] = placements[-1] @ origin(path, element)
        if kind != "fixed":
            turn = _align(_axis(path, element))
            placements[-1] = placements[-1] @ turn
            placements.append(turn.T)
            joints.append(_joint(path, element, kind))
    if not joints:
        raise InputError(f"no joint moves between '{base_link}' and '{tip_link}'", file=path)
    robot = craig_robot(root.attributes.get("name") or path.stem, joints, placements)
    x, y, z = (float(value) + 0.0 for value in robot.base[:3, :3].T @ DOWN)  # + 0.0: no minus before a zero
    return replace(robot, down=(x, y, z), masses=carried_masses(path, root, way, robot))


def _path(path: Path, root: Element, base: str, tip: str) -> list[Element]:
    """The joints from base to tip, in order."""
    parents: dict[str, tuple[str, Element]] = {}
    for joint in (child for child in root.children if child.tag == "joint"):
        parent, child = joint.get("parent", "link"), joint.get("child", "link")
        if parent is None or child is None:
            raise InputError("a joint needs a parent and a child link", file=path, line=joint.line, key=name_of(joint))
        if child in parents:
            message = f"link '{child}' is the child of two joints: not a tree"
            raise InputError(message, file=path, line=joint.line, key=name_of(joint))
        parents[child] = (parent, joint)
    joints: list[Element] = []
    link = tip
    while link != base:
        if link not in parents or len(joints) > len(parents):
            way = (
                "it is the other way round"
                if not joints and _reaches(parents, base, tip)
                else f"the way up from the tip ends at '{link}'"
            )
            raise InputError(f"'{tip}' does not hang on '{base}': {way}", file=path)
        link, joint = parents[link]
        joints.append(joint)
    return joints[::-1]


def _reaches(parents: dict[str, tuple[str, Element]], link: str, ancestor: str) -> bool:
    for _ in range(len(parents)):
        if link not in parents:
            return False
        link = parents[link][0]
        if link == ancestor:
            return True
    return False


def _kind(path: Path, joint: Element) -> str:
    kind = joint.attributes.get("type")
    if kind not in JOINT_TYPES:
        message = "a serial robot cannot have a joint of this type between base and tip"
        raise InputError(message, file=path, line=joint.line, key=name_of(joint), found=kind, allowed=JOINT_TYPES)
    mimic = joint.child("mimic")
    if mimic is not None and kind != "fixed":
        message = "this joint mimics another: it has no reading of its own, so it cannot stand between base and tip"
        raise InputError(message, file=path, line=mimic.line, key=name_of(joint), found=mimic.attributes.get("joint"))
    return kind


def _axis(path: Path, joint: Element) -> Array:
    axis = numbers(path, joint, "axis", "xyz", (1.0, 0.0, 0.0))
    size = float(np.linalg.norm(axis))
    if size < 1e-6:
        raise InputError(
            "the axis of a joint that moves cannot be zero", file=path, line=joint.line, key=name_of(joint)
        )
    return axis / size


def _align(axis: Array) -> Array:
    """The shortest turn of z onto an axis, shape (4, 4); half a turn about x onto -z."""
    x, y, z = axis
    sine = math.hypot(x, y)
    if sine < 1e-15:
        turn = np.diag([1.0, math.copysign(1.0, z), math.copysign(1.0, z)])
    else:
        normal, other = np.array([-y, x, 0.0]) / sine, np.array([x, y, 0.0]) / sine  # normal = z x axis
        frame = np.column_stack([other, normal, [0.0, 0.0, 1.0]])
        turn = frame @ np.array([[z, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, z]]) @ frame.T
    return spatial.transform(turn, np.zeros(3))


def _joint(path: Path, joint: Element, kind: str) -> Joint:
    name = joint.attributes.get("name")
    if not name:
        raise InputError("this joint has no name", file=path, line=joint.line)
    unit = MM if kind == "prismatic" else 1.0
    lower, upper = -math.inf, math.inf
    if kind != "continuous":
        limit = joint.child("limit")
        if limit is None:
            raise InputError(f"a {kind} joint needs a 'limit'", file=path, line=joint.line, key=name)
        lower = float(numbers(path, joint, "limit", "lower", (0.0,))[0]) * unit
        upper = float(numbers(path, joint, "limit", "upper", (0.0,))[0]) * unit
        if not lower < upper:
            instead = " or continuous" if kind == "revolute" else ""
            message = f"the limits leave no motion: make the joint fixed{instead}, or widen them"
            raise InputError(
                message, file=path, line=limit.line, key=name, found=f"{lower / unit:g} to {upper / unit:g}"
            )
    speed = float(numbers(path, joint, "limit", "velocity", (0.0,))[0]) * unit
    return Joint(
        kind="prismatic" if kind == "prismatic" else "revolute",
        name=name,
        lower=lower,
        upper=upper,
        speed=speed if speed > 0 else None,
    )
