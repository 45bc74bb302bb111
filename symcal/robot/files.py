"""Robot files: what `symcal.robot.schema` lets through as a robot, and a robot as its file."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.documents.document import write_document
from symcal.robot.robot import Joint, Link, Record, Robot
from symcal.robot.schema import LINK_PARAMETERS, SCHEMA, CalibrationEntry, LinkEntry, read_robot_file
from symcal.robot.schema import Convention as Convention
from symcal.robot.schema import Frame as Frame
from symcal.robot.schema import JointKind as JointKind
from symcal.robot.schema import is_angle as is_angle
from symcal.robot.terms import Physics, physics_entries
from symcal.units import ANGLE, LENGTH, AngleUnit, LengthUnit, unit_factor

Array = NDArray[np.float64]


def load_robot(path: Path | str) -> Robot:
    """Read a robot file (nominal or calibrated).

    Raises:
        InputError: with file, line and key, for anything that is not as the schema says or cannot be.

    Example:
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/ur5.yaml")
        >>> [joint.name for joint in robot.joints][:3]
        ['shoulder_pan', 'shoulder_lift', 'elbow']
    """
    file, physics = read_robot_file(path)
    length, angle = LENGTH[file.units.length], ANGLE[file.units.angle]
    robot = Robot(
        name=file.name,
        convention=file.convention,
        links=tuple(
            _link(entry, name, length, angle) for entry, name in zip(file.links, file.joint_names, strict=True)
        ),
        base=file.base.matrix(length, angle),
        tool=file.tool.matrix(length, angle),
        record=_record(file.calibration, length, angle),
        terms=physics.terms,
        down=physics.down,
        masses=physics.masses,
        payload=physics.payload,
        remainder=physics.remainder,
    )
    units = {p.name: unit_factor(p.unit, length, angle) for p in robot.described}
    return replace(robot, scales={name: size * units[name] for name, size in file.scales.items()})


def _link(entry: LinkEntry, name: str, length: float, angle: float) -> Link:
    unit = angle if entry.joint == "revolute" else length
    listed = {kind: getattr(entry, kind) for kind in LINK_PARAMETERS}
    parameters = {k: v * (angle if is_angle(k) else length) for k, v in listed.items() if v is not None}
    lower, upper = (x * unit for x in entry.limits) if entry.limits else (-math.inf, math.inf)
    joint = Joint(
        kind=entry.joint,
        name=name,
        lower=lower,
        upper=upper,
        sign=entry.sign,
        ratio=entry.ratio,
        offset=entry.offset * unit,
        speed=None if entry.speed is None else entry.speed * unit,
    )
    return Link(joint, parameters)


def _record(c: CalibrationEntry | None, length: float, angle: float) -> Record | None:
    if c is None:
        return None
    return Record(
        errors=c.errors,
        sigmas=c.sigmas,
        covariance=np.array(c.covariance).reshape(len(c.errors), len(c.errors)),
        nominal_base=c.nominal_base.matrix(length, angle),
        nominal_tool=c.nominal_tool.matrix(length, angle),
        provenance=c.provenance.facts,
    )


def save_robot(robot: Robot, path: Path | str, units: tuple[LengthUnit, AngleUnit] = ("mm", "deg")) -> None:
    """Write a robot file that `load_robot` reads back; a calibration's errors, sigmas, covariance stay in mm and rad.

    Raises:
        InputError: the file cannot be written.

    Example:
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/ur5.yaml")
        >>> sc.save_robot(robot, "copy.yaml")
        >>> sc.load_robot("copy.yaml").parameters == robot.parameters
        True
    """
    write_document(path, robot_entries(robot, units))


def robot_entries(robot: Robot, units: tuple[LengthUnit, AngleUnit] = ("mm", "deg")) -> dict[str, Any]:
    """What stands in the file of a robot, by key."""
    length, angle = LENGTH[units[0]], ANGLE[units[1]]
    data: dict[str, Any] = {
        "schema": SCHEMA,
        "name": robot.name,
        "convention": robot.convention,
        "units": {"length": units[0], "angle": units[1]},
        "links": [_link_entry(link, length, angle) for link in robot.links],
        "base": frame_entry(robot.base, length),
        "tool": frame_entry(robot.tool, length),
    }
    if robot.scales:
        factors = {p.name: unit_factor(p.unit, length, angle) for p in robot.described}
        data["scales"] = {name: value / factors[name] for name, value in robot.scales.items()}
    physics = Physics(robot.terms, robot.down, robot.masses, robot.payload, robot.remainder)
    data |= physics_entries(physics, [joint.name for joint in robot.joints], length, angle)
    if robot.record is not None:
        data["calibration"] = {
            "errors": {k: float(v) for k, v in robot.record.errors.items()},
            "sigmas": {k: None if v is None else float(v) for k, v in robot.record.sigmas.items()},
            "covariance": robot.record.covariance.tolist(),
            "nominal_base": frame_entry(robot.record.nominal_base, length),
            "nominal_tool": frame_entry(robot.record.nominal_tool, length),
            "provenance": dict(robot.record.provenance),
        }
    return data


def frame_entry(matrix: Array, length: float = 1.0) -> dict[str, list[float]]:
    """A frame as files say it: xyz in units of ``length`` mm, and a unit quaternion."""
    pose = spatial.matrix_pose(matrix)
    return {"xyz": (pose[:3] / length).tolist(), "quat_xyzw": pose[3:].tolist()}


def _link_entry(link: Link, length: float, angle: float) -> dict[str, Any]:
    joint = link.joint
    unit = angle if joint.revolute else length
    entry: dict[str, Any] = {"joint": joint.kind, "name": joint.name}
    if math.isfinite(joint.lower) and math.isfinite(joint.upper):
        entry["limits"] = [joint.lower / unit, joint.upper / unit]
    if joint.speed is not None:
        entry["speed"] = joint.speed / unit
    if joint.sign != 1:
        entry["sign"] = joint.sign
    if joint.ratio != 1:
        entry["ratio"] = joint.ratio
    if joint.offset != 0:
        entry["offset"] = joint.offset / unit
    return entry | {k: v / (angle if is_angle(k) else length) for k, v in link.parameters.items()}
