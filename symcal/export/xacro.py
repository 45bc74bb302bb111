"""A robot as two xacro files: the numbers as properties, and the URDF that is made of them.

A description that exists already takes the properties alone, in place of the numbers of its joints' origins.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET  # written here, never parsed from elsewhere
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.errors import RefusedError
from symcal.export.urdf import urdf_poses
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

PROPERTIES, ROBOT = "calibration.xacro", "robot.urdf.xacro"
_SPACE = "http://www.ros.org/wiki/xacro"
_AXES = (("xyz", ("x", "y", "z")), ("rpy", ("roll", "pitch", "yaw")))


def xacro_files(urdf: str) -> dict[str, str]:
    """The files by name, from the text of a URDF (`symcal.export.urdf.urdf_text`): m and rad, with all digits.

    The origin of joint `elbow` is the properties `elbow_x`, `elbow_y`, `elbow_z`, `elbow_roll`, `elbow_pitch` and
    `elbow_yaw`.

    Raises:
        RefusedError: two joints would have the same properties, as their names differ only in signs.
    """
    ET.register_namespace("xacro", _SPACE)
    root = ET.fromstring(urdf)
    properties = ET.Element("robot", {"xmlns:xacro": _SPACE})
    properties.append(ET.Comment(" kinematics written by symcal: origins of joints, in m and rad (Rz Ry Rx) "))
    taken: dict[str, str] = {}
    for joint in root.iter("joint"):
        stem = _identifier(joint.attrib["name"])
        if stem in taken:
            raise RefusedError(
                f"joints {taken[stem]} and {joint.attrib['name']} would both be the properties {stem}_x ...: "
                "give one another name in the robot file"
            )
        taken[stem] = joint.attrib["name"]
        origin = joint.find("origin")
        assert origin is not None
        for attribute, axes in _AXES:
            for axis, value in zip(axes, origin.attrib[attribute].split(), strict=True):
                ET.SubElement(properties, "xacro:property", name=f"{stem}_{axis}", value=value)
            origin.set(attribute, " ".join(f"${{{stem}_{axis}}}" for axis in axes))
    root.set("xmlns:xacro", _SPACE)
    root.insert(0, ET.Comment(" kinematics written by symcal; its numbers are in calibration.xacro "))
    root.insert(1, ET.Element("xacro:include", filename=PROPERTIES))
    return {PROPERTIES: _text(properties), ROBOT: _text(root)}


def xacro_poses(folder: Path, q: Array, robot: Robot) -> Array:
    """T_base_tool of the files, by ROS's xacro and yourdfpy; as `symcal.export.urdf.urdf_poses`."""
    import xacro

    made = xacro.process_file(str(folder / ROBOT)).toprettyxml()
    (folder / "made.urdf").write_text(made, encoding="utf-8")
    return urdf_poses(folder, q, robot, "made.urdf")


def _identifier(name: str) -> str:
    """A joint's name as a property's: xacro evaluates properties as Python names."""
    stem = re.sub(r"\W", "_", name)
    return f"_{stem}" if stem[:1].isdigit() else stem


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
