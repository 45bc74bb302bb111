"""The robot of a first calibration as a file for people: an arm of the list, or a chain of a URDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from symcal.drafts.experiment import quoted
from symcal.errors import InputError
from symcal.robot.arms import arm, arm_file
from symcal.robot.files import load_robot, robot_entries
from symcal.robot.robot import Robot
from symcal.robot.urdf import load_urdf
from symcal.robot.urdf_xml import Element, read_urdf

_DIGITS = 12  # of numbers that were converted from rad and m: more are rounding
_LIMIT_DECIMALS = 3  # of limits and speeds, which no geometry depends on


@dataclass(frozen=True, slots=True)
class RobotDraft:
    """title: what people call it. text: of robot.yaml. notes: what was chosen and should be looked at."""

    robot: Robot
    title: str
    text: str
    notes: tuple[str, ...] = ()


def of_arm(name: str) -> RobotDraft:
    """An arm of the list.

    Raises:
        InputError: no arm has this name.
    """
    facts, path = arm(name), arm_file(name)
    robot, text = load_robot(path), path.read_text(encoding="utf-8")
    title = f"{facts.maker} {facts.model}"
    head = f"# {title}: nominal numbers of the type, not of the arm that stands there. Where they are from:\n"
    notes = () if facts.checked else (f"the numbers of the {title} have one source: compare them with its manual",)
    return RobotDraft(robot, title, head + text + ("" if "\ntool:" in text else _TOOL), notes)


_TOOL = """\
# The tool frame is that of the flange. If readings, targets or commands are about another one, say where it is:
# tool: {xyz: [0, 0, 0], rpy: [0, 0, 0]}
"""


def of_urdf(path: Path, base: str | None = None, tip: str | None = None) -> RobotDraft:
    """The chain between two links of a URDF file; its root and its only end where they are not named.

    Raises:
        InputError: as `load_urdf`; or the file has several ends and none is named.
    """
    first, last = base or urdf_ends(path)[0], tip
    if last is None:
        _, ends = urdf_ends(path)
        if len(ends) != 1:
            message = "the robot has several ends: say which link the tool is on"
            raise InputError(message, file=path, key="--tip", allowed=ends)
        (last,) = ends
    robot = load_urdf(path, first, last)
    notes = () if base and tip else (f"the chain is from '{first}' to '{last}': --base and --tip name others",)
    head = (
        f"# {' '.join(robot.name.split())}: the joints from '{first}' to '{last}' of {path.name}, in Craig's "
        f"convention.\n# The tool frame is '{last}': 'base' and 'tool' are what is before and after the joints.\n"
    )
    return RobotDraft(robot, robot.name, head + _lines(_entries(robot)), notes)


def urdf_ends(path: Path) -> tuple[str, tuple[str, ...]]:
    """The root link of a URDF file, and the links that nothing moves against: those a chain could end at.

    Raises:
        InputError: not a URDF file, or it has no single root.
    """
    root = read_urdf(path)
    links = [child.attributes.get("name", "") for child in root.children if child.tag == "link"]
    joints = [child for child in root.children if child.tag == "joint"]
    below = {joint.get("child", "link") for joint in joints}
    tops = [link for link in links if link not in below]
    if len(tops) != 1:
        raise InputError(
            "no single link carries all others: say which is the base", file=path, key="--base", allowed=tops
        )
    above = {joint.get("parent", "link") for joint in joints}
    return tops[0], tuple(link for link in links if link not in above and _moves(joints, link))


def _moves(joints: Sequence[Element], link: str) -> bool:
    """Whether any joint above a link can move."""
    by_child = {joint.get("child", "link"): joint for joint in joints}
    for _ in range(len(joints)):
        joint = by_child.get(link)
        if joint is None:
            return False
        if joint.attributes.get("type") != "fixed":
            return True
        link = joint.get("parent", "link") or ""
    return False


def _entries(robot: Robot) -> dict[str, Any]:
    """What stands in the file, without frames that are none, and with limits that can be read."""
    entries = robot_entries(robot)
    for name, frame in (("base", robot.base), ("tool", robot.tool)):
        if np.allclose(frame, np.eye(4), atol=1e-12):
            del entries[name]
    for link in entries["links"]:
        if "limits" in link:
            link["limits"] = [round(limit, _LIMIT_DECIMALS) for limit in link["limits"]]
        if "speed" in link:
            link["speed"] = round(link["speed"], _LIMIT_DECIMALS)
    return entries


def _lines(entries: Mapping[str, object]) -> str:
    """A robot file with a line for each link."""
    lines: list[str] = []
    for key, value in entries.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            lines += [f"{key}:", *(f"  - {_flow(item)}" for item in value)]
        else:
            lines.append(f"{key}: {_flow(value)}")
    return "\n".join(lines) + "\n"


def _flow(value: object) -> str:
    """A value in one line of YAML."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{quoted(str(name))}: {_flow(each)}' for name, each in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_flow, value))}]"
    if isinstance(value, float):
        return f"{round(value, _DIGITS) + 0.0:.{_DIGITS}g}"
    return quoted(value) if isinstance(value, str) else str(value)
