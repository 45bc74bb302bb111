"""Robots from URDF files: the chain of joints between two links, exactly, as a table of link parameters.

Only what moves is read: links by name, joints with origin, axis and limits. Meshes, inertias and everything else are
passed over. XML is read with expat, document types (and with them every entity) refused.

Source: http://wiki.ros.org/urdf/XML
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.errors import InputError
from symcal.robot.conventions import craig_robot
from symcal.robot.robot import Joint, Robot

Array = NDArray[np.float64]

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed")
"""The joint types that a serial chain may have."""

_MM = 1000.0  # per metre, URDF's unit


@dataclass(frozen=True, slots=True)
class _Element:
    """An XML element with the line of its tag."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[_Element] = field(default_factory=list)

    def child(self, tag: str) -> _Element | None:
        return next((child for child in self.children if child.tag == tag), None)

    def get(self, tag: str, attribute: str) -> str | None:
        child = self.child(tag)
        return None if child is None else child.attributes.get(attribute)


def load_urdf(path: Path | str, base_link: str, tip_link: str) -> Robot:
    """The serial robot between two links of a URDF file, in the `craig` convention (`conventions.craig_robot`).

    T_world_tool of the result is the pose of ``tip_link`` in ``base_link``, with joint readings as URDF defines them
    (in mm where it says m). Joint names, limits and speeds are kept; continuous joints have no limits.

    Raises:
        InputError: not a URDF file, no such link, no chain of revolute, continuous, prismatic and fixed joints from
            base to tip, or a joint that cannot be read; with its line.
    """
    path = Path(path)
    root = _read(path)
    links = {child.attributes.get("name", "") for child in root.children if child.tag == "link"}
    for role, link in (("base", base_link), ("tip", tip_link)):
        if link not in links:
            raise InputError(
                f"the file has no link of this name (as {role})", file=path, found=link, allowed=sorted(links)
            )
    joints: list[Joint] = []
    placements = [np.eye(4)]
    for element in _path(path, root, base_link, tip_link):
        kind = _kind(path, element)
        placements[-1] = placements[-1] @ _origin(path, element)
        if kind != "fixed":
            turn = _align(_axis(path, element))
            placements[-1] = placements[-1] @ turn
            placements.append(turn.T)
            joints.append(_joint(path, element, kind))
    if not joints:
        raise InputError(f"no joint moves between '{base_link}' and '{tip_link}'", file=path)
    return craig_robot(root.attributes.get("name") or path.stem, joints, placements)


def _read(path: Path) -> _Element:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"the file cannot be read: {error.strerror}", file=path) from None
    parser = expat.ParserCreate()
    top = _Element("", {}, 0)
    stack = [top]

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = _Element(tag, attributes, parser.CurrentLineNumber)
        stack[-1].children.append(element)
        stack.append(element)

    def doctype(*_: object) -> None:
        raise InputError(
            "a URDF file has no document type: refused, with its entities", file=path, line=parser.CurrentLineNumber
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(f"not valid XML: {expat.errors.messages[error.code]}", file=path, line=error.lineno) from None
    except (UnicodeError, LookupError, ValueError) as error:  # an encoding that expat hands to Python
        raise InputError(f"not valid XML: {error}", file=path) from None
    root = top.children[0]
    if root.tag != "robot":
        message = "not a URDF file: the outermost element must be 'robot'"
        if any(child.tag.startswith("xacro:") for child in root.children):
            message = "this is a xacro file: expand it to URDF first (xacro file.xacro > file.urdf)"
        raise InputError(message, file=path, line=root.line, found=root.tag)
    macro = next((child for child in root.children if child.tag.startswith("xacro:")), None)
    if macro is not None:
        message = "this is a xacro file: expand it to URDF first (xacro file.xacro > file.urdf)"
        raise InputError(message, file=path, line=macro.line, found=macro.tag)
    return root


def _path(path: Path, root: _Element, base: str, tip: str) -> list[_Element]:
    """The joints from base to tip, in order."""
    parents: dict[str, tuple[str, _Element]] = {}
    for joint in (child for child in root.children if child.tag == "joint"):
        parent, child = joint.get("parent", "link"), joint.get("child", "link")
        if parent is None or child is None:
            raise InputError("a joint needs a parent and a child link", file=path, line=joint.line, key=_name(joint))
        if child in parents:
            message = f"link '{child}' is the child of two joints: not a tree"
            raise InputError(message, file=path, line=joint.line, key=_name(joint))
        parents[child] = (parent, joint)
    joints: list[_Element] = []
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


def _reaches(parents: dict[str, tuple[str, _Element]], link: str, ancestor: str) -> bool:
    for _ in range(len(parents)):
        if link not in parents:
            return False
        link = parents[link][0]
        if link == ancestor:
            return True
    return False


def _name(joint: _Element) -> str:
    return joint.attributes.get("name", "joint")


def _kind(path: Path, joint: _Element) -> str:
    kind = joint.attributes.get("type")
    if kind not in JOINT_TYPES:
        message = "a serial robot cannot have a joint of this type between base and tip"
        raise InputError(message, file=path, line=joint.line, key=_name(joint), found=kind, allowed=JOINT_TYPES)
    mimic = joint.child("mimic")
    if mimic is not None and kind != "fixed":
        message = "this joint mimics another: it has no reading of its own, so it cannot stand between base and tip"
        raise InputError(message, file=path, line=mimic.line, key=_name(joint), found=mimic.attributes.get("joint"))
    return kind


def _numbers(path: Path, joint: _Element, tag: str, attribute: str, default: tuple[float, ...]) -> Array:
    """Numbers of an attribute of a joint's child element, as many as the default has."""
    text = joint.get(tag, attribute)
    if text is None:
        return np.array(default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([math.nan])
    if len(values) != len(default) or not np.isfinite(values).all():
        line = next(child.line for child in joint.children if child.tag == tag)
        count = "a finite number" if len(default) == 1 else f"{len(default)} finite numbers"
        raise InputError(
            f"'{attribute}' of '{tag}' must be {count}", file=path, line=line, key=_name(joint), found=text
        )
    return values


def _origin(path: Path, joint: _Element) -> Array:
    xyz = _numbers(path, joint, "origin", "xyz", (0.0, 0.0, 0.0))
    return spatial.transform(spatial.rpy_matrix(_numbers(path, joint, "origin", "rpy", (0.0, 0.0, 0.0))), xyz * _MM)


def _axis(path: Path, joint: _Element) -> Array:
    axis = _numbers(path, joint, "axis", "xyz", (1.0, 0.0, 0.0))
    size = float(np.linalg.norm(axis))
    if size < 1e-6:
        raise InputError("the axis of a joint that moves cannot be zero", file=path, line=joint.line, key=_name(joint))
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


def _joint(path: Path, joint: _Element, kind: str) -> Joint:
    name = joint.attributes.get("name")
    if not name:
        raise InputError("this joint has no name", file=path, line=joint.line)
    unit = _MM if kind == "prismatic" else 1.0
    lower, upper = -math.inf, math.inf
    if kind != "continuous":
        limit = joint.child("limit")
        if limit is None:
            raise InputError(f"a {kind} joint needs a 'limit'", file=path, line=joint.line, key=name)
        lower = float(_numbers(path, joint, "limit", "lower", (0.0,))[0]) * unit
        upper = float(_numbers(path, joint, "limit", "upper", (0.0,))[0]) * unit
        if not lower < upper:
            instead = " or continuous" if kind == "revolute" else ""
            message = f"the limits leave no motion: make the joint fixed{instead}, or widen them"
            raise InputError(
                message, file=path, line=limit.line, key=name, found=f"{lower / unit:g} to {upper / unit:g}"
            )
    speed = float(_numbers(path, joint, "limit", "velocity", (0.0,))[0]) * unit
    return Joint(
        kind="prismatic" if kind == "prismatic" else "revolute",
        name=name,
        lower=lower,
        upper=upper,
        speed=speed if speed > 0 else None,
    )
