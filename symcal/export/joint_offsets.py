"""Zero offsets of the joints alone: for a controller that takes nothing else ('mastering').

The zeros of a full identification hold only together with its lengths and twists. Here are those with which the
nominal arm comes nearest to the calibrated one, by least squares over postures within the limits.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from symcal import spatial
from symcal.errors import RefusedError
from symcal.export.joint_zeros import WEIGHTS, least_zeros, shifted, slopes_of_zeros
from symcal.export.urdf import urdf_poses, urdf_text
from symcal.outputs.csv_text import csv_text
from symcal.robot.robot import Robot

Array = NDArray[np.float64]

TABLE, ROS, TRANSMISSIONS = "joint_offsets.csv", "joint_offsets.yaml", "transmissions.xml"
COLUMNS = ("joint", "unit", "add_to_reading")

_POSTURES = 1024
_STEPS = 4  # of Gauss-Newton: the zeros are mrad, two do


@dataclass(frozen=True, slots=True, eq=False)
class JointOffsets:
    """What to add to each reading, shape (dof,), rad or mm.

    nominal: the arm before its calibration, with the calibrated tool and no terms. robot: the same with these zeros.
    nominal_mm, offsets_mm: rms distance between its tool and that of the calibrated arm over postures within the
    limits, with the nominal zeros and with these; largest_mm: the largest of the latter. nominal_deg, offsets_deg: the
    same of the tool's attitude, rms.
    """

    nominal: Robot
    robot: Robot
    readings: Array
    nominal_mm: float
    offsets_mm: float
    largest_mm: float
    nominal_deg: float
    offsets_deg: float

    @property
    def text(self) -> str:
        return (
            f"with these zeros the nominal arm's tool is {self.offsets_mm:.3g} mm rms (largest {self.largest_mm:.3g}) "
            f"and {self.offsets_deg:.2g} deg rms from the calibrated one over {_POSTURES} random postures; "
            f"{self.nominal_mm:.3g} mm and {self.nominal_deg:.2g} deg rms without them"
        )


def joint_offsets(robot: Robot) -> JointOffsets:
    """The zeros for a calibrated robot; its tool, with joint terms at nominal conditions, is what they aim at.

    Raises:
        RefusedError: the robot was never calibrated.
    """
    if robot.record is None:
        raise RefusedError(f"{robot.name} was never calibrated: there are no offsets to hand over")
    rng = np.random.default_rng(0)
    fitted, judged = (rng.uniform(*robot.ranges, (_POSTURES, robot.dof)) for _ in range(2))
    nominal = replace(robot.nominal(), base=robot.base, tool=robot.tool, terms=())
    rates = np.array([joint.sign * joint.ratio for joint in robot.joints])
    shifts, wanted = np.zeros(robot.dof), slopes_of_zeros(robot, fitted)[0]
    for _ in range(_STEPS):
        poses, slopes = slopes_of_zeros(shifted(nominal, shifts), fitted)
        shifts = shifts + least_zeros(nominal, slopes, _differences(wanted, poses) * WEIGHTS)
    found, calibrated = shifted(nominal, shifts), slopes_of_zeros(robot, judged)[0]
    before, after = (_differences(calibrated, slopes_of_zeros(each, judged)[0]) for each in (nominal, found))
    (nominal_mm, nominal_deg), (offsets_mm, offsets_deg) = (_sizes(each) for each in (before, after))
    largest = float(np.linalg.norm(after[:, :3], axis=1).max())
    return JointOffsets(nominal, found, shifts / rates, nominal_mm, offsets_mm, largest, nominal_deg, offsets_deg)


def offset_files(found: JointOffsets) -> dict[str, str]:
    """A table in deg and mm, and the same for ROS 2 in rad and m: by name, and as transmissions of ros2_control.

    There joint = actuator / mechanical_reduction + offset (ros2_control, transmission_interface/SimpleTransmission).
    """
    joints = found.robot.joints
    rows = [
        {
            "joint": joint.name,
            "unit": "deg" if joint.revolute else "mm",
            "add_to_reading": math.degrees(value) if joint.revolute else value,
        }
        for joint, value in zip(joints, found.readings.tolist(), strict=True)
    ]
    si = {j.name: v if j.revolute else v * 1e-3 for j, v in zip(joints, found.readings.tolist(), strict=True)}
    said = f"# joint offsets written by symcal: rad and m, to be added to the joint's reading\n# {found.text}\n"
    root = ET.Element("ros2_control", name=found.robot.name, type="system")
    root.append(ET.Comment(" joint offsets written by symcal: take the offsets into the transmissions that you have "))
    for name, value in si.items():
        transmission = ET.SubElement(root, "transmission", name=f"{name}_transmission")
        ET.SubElement(transmission, "plugin").text = "transmission_interface/SimpleTransmission"
        ET.SubElement(transmission, "actuator", name=f"{name}_actuator", role="actuator1")
        joint = ET.SubElement(transmission, "joint", name=name, role="joint1")
        ET.SubElement(joint, "mechanical_reduction").text = "1.0"
        ET.SubElement(joint, "offset").text = repr(value)
    ET.indent(root)
    dumped = yaml.safe_dump({"joint_offsets": si}, sort_keys=False, allow_unicode=True)
    return {TABLE: csv_text(rows, COLUMNS), ROS: said + dumped, TRANSMISSIONS: ET.tostring(root, "unicode") + "\n"}


def offset_poses(folder: Path, q: Array, nominal: Robot) -> Array:
    """T_base_tool of the nominal URDF by yourdfpy, with the offsets of `ROS` added to the readings: proves the sign."""
    read = yaml.safe_load((folder / ROS).read_text(encoding="utf-8"))["joint_offsets"]
    names = [joint.name for joint in nominal.joints]
    positions = q + [read[name] / (1 if j.revolute else 1e-3) for name, j in zip(names, nominal.joints, strict=True)]
    direct = _without_gears(nominal)
    path = folder / "nominal.urdf"
    path.write_text(urdf_text(direct), encoding="utf-8")
    return urdf_poses(folder, positions * [joint.ratio for joint in nominal.joints], direct, path.name)


def _without_gears(robot: Robot) -> Robot:
    """With ratios of 1 and limits, as URDF wants it; positions are ratio times the readings."""
    joints = [
        replace(link.joint, ratio=1.0, lower=float(lower), upper=float(upper))
        for link, lower, upper in zip(robot.links, *robot.ranges, strict=True)
    ]
    links = tuple(replace(link, joint=joint) for link, joint in zip(robot.links, joints, strict=True))
    return replace(robot, links=links)


def _differences(wanted: Array, poses: Array) -> Array:
    """Translations and rotation vectors that bring poses where they are wanted, shape (n, 6), mm and rad."""
    turns = wanted[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1)
    return np.concatenate([wanted[:, :3, 3] - poses[:, :3, 3], spatial.matrix_vectors(turns)], axis=1)


def _sizes(differences: Array) -> tuple[float, float]:
    """Rms mm and deg."""
    mm, rad = (np.sqrt((part**2).sum(axis=1).mean()) for part in (differences[:, :3], differences[:, 3:]))
    return float(mm), float(np.degrees(rad))
