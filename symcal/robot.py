"""A serial robot as frozen data, and its YAML file.

Conventions ([Ding2017] Table I is the first, [Craig2005] sec. 3.4 the second; beta after [Hayati1985]):
    standard (distal):   T_i = Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)
    craig (proximal):    T_i = Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d)
The joint variable adds to theta (revolute) or d (prismatic). A link lists only the parameters that its transform contains.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError
from scipy.spatial.transform import Rotation

from symcal import spatial
from symcal.documents import Document, Strict, read_document, validate, write_document
from symcal.errors import InputError
from symcal.units import ANGLE, LENGTH, AngleUnit, LengthUnit

Array = NDArray[np.float64]
Convention = Literal["standard", "craig"]
JointKind = Literal["revolute", "prismatic"]

LINK_PARAMETERS = ("theta", "alpha", "a", "d", "beta")
"""The kinds of link parameters, in the order of the parameter vector ([Ding2017] eq. 3)."""

SCHEMA = "symcal/robot/1"


def is_angle(parameter: str) -> bool:
    """Whether a link parameter is an angle (rad) rather than a length (mm)."""
    return parameter in ("theta", "alpha", "beta")


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint: q_model = sign * ratio * reading + offset.

    lower, upper: limits of the reading, rad or mm; infinite when the file gives none.
    speed: largest speed of the reading, rad/s or mm/s; None when not given.
    """

    kind: JointKind
    name: str
    lower: float = -math.inf
    upper: float = math.inf
    sign: int = 1
    ratio: float = 1.0
    offset: float = 0.0
    speed: float | None = None

    @property
    def revolute(self) -> bool:
        return self.kind == "revolute"


@dataclass(frozen=True, slots=True)
class Link:
    """One joint and the link parameters that its transform contains (rad, mm)."""

    joint: Joint
    parameters: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Record:
    """What an identification left in a calibrated robot: its numbers are already in the robot, this says where they come from.

    errors: identified minus nominal by parameter name, mm or rad; base and tool increments included.
    sigmas: standard deviation by name, or None where the data do not determine the parameter.
    covariance: of all parameters in the order of ``errors``, shape (n, n); unseen directions have variance zero here.
    nominal_base, nominal_tool: the frames that the increments refer to.
    provenance: free facts (inputs, seed, versions, accuracy).
    """

    errors: Mapping[str, float]
    sigmas: Mapping[str, float | None]
    covariance: Array
    nominal_base: Array
    nominal_tool: Array
    provenance: Mapping[str, Any] = field(default_factory=dict)


def _identity() -> Array:
    return np.eye(4)


@dataclass(frozen=True, slots=True)
class Robot:
    """A serial chain: T_world_tool(q) = base * T_1(q_1) ... T_n(q_n) * tool.

    base: T_world_base, tool: T_flange_tool; nominal, shape (4, 4), mm.
    scales: plausible size of an error by parameter name (mm, rad) where it is not the default.
    """

    name: str
    convention: Convention
    links: tuple[Link, ...]
    base: Array = field(default_factory=_identity)
    tool: Array = field(default_factory=_identity)
    scales: Mapping[str, float] = field(default_factory=dict)
    record: Record | None = None

    @property
    def dof(self) -> int:
        return len(self.links)

    @property
    def joints(self) -> tuple[Joint, ...]:
        return tuple(link.joint for link in self.links)

    @property
    def lower(self) -> Array:
        """Lower limits of the readings, shape (n,), rad or mm."""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> Array:
        """Upper limits of the readings, shape (n,), rad or mm."""
        return np.array([joint.upper for joint in self.joints])

    @property
    def parameters(self) -> dict[str, float]:
        """Link parameters by name (`theta_1`, ...), by kind and then by link: the order of the parameter vector."""
        return {
            f"{kind}_{i}": link.parameters[kind]
            for kind in LINK_PARAMETERS
            for i, link in enumerate(self.links, start=1)
            if kind in link.parameters
        }

    @property
    def reach(self) -> float:
        """An upper bound of the arm's extent in mm: link lengths, finite prismatic travel and the tool."""
        lengths = sum(abs(v) for name, v in self.parameters.items() if name[0] in "ad" and not name.startswith("alpha"))
        travel = sum(
            max((abs(j.sign * j.ratio * q + j.offset) for q in (j.lower, j.upper) if math.isfinite(q)), default=0.0)
            for j in self.joints
            if not j.revolute
        )
        return float(lengths + travel + np.linalg.norm(self.tool[:3, 3]))

    def corrected(self, errors: Mapping[str, float]) -> Robot:
        """The robot with errors (mm, rad) added to its link parameters; names that it lacks are a KeyError."""
        known = self.parameters
        for name in errors:
            if name not in known:
                raise KeyError(name)
        links = tuple(
            replace(link, parameters={k: v + errors.get(f"{k}_{i}", 0.0) for k, v in link.parameters.items()})
            for i, link in enumerate(self.links, start=1)
        )
        return replace(self, links=links)

    def nominal(self) -> Robot:
        """The robot before its calibration; itself if it was never calibrated."""
        if self.record is None:
            return self
        errors = {name: -value for name, value in self.record.errors.items() if name in self.parameters}
        return replace(
            self.corrected(errors), base=self.record.nominal_base, tool=self.record.nominal_tool, record=None
        )


# ------------------------------------------------------------------------------------------------ the file's schema


class _Units(Strict):
    length: LengthUnit
    angle: AngleUnit


class Frame(Strict):
    """A frame in a file: `{xyz, rpy}` (R = Rz(yaw) Ry(pitch) Rx(roll)) or `{xyz, quat_xyzw}`."""

    xyz: Annotated[list[float], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    rpy: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    quat_xyzw: Annotated[list[float], Field(min_length=4, max_length=4)] | None = None

    @model_validator(mode="after")
    def _one_rotation(self) -> Frame:
        if self.rpy is not None and self.quat_xyzw is not None:
            raise PydanticCustomError("frame", "a frame has 'rpy' or 'quat_xyzw', not both")
        if self.quat_xyzw is not None and abs(np.linalg.norm(self.quat_xyzw) - 1) > 1e-3:
            raise PydanticCustomError("frame", "'quat_xyzw' must be a unit quaternion (x, y, z, w)")
        return self

    def matrix(self, length: float, angle: float) -> Array:
        """T (4, 4) in mm; length and angle are mm and rad per unit of the file."""
        if self.quat_xyzw is not None:
            rotation = Rotation.from_quat(self.quat_xyzw).as_matrix()
        else:
            rotation = spatial.rpy_matrix(np.asarray(self.rpy or [0.0, 0.0, 0.0]) * angle)
        return spatial.transform(rotation, np.asarray(self.xyz) * length)


class _Link(Strict):
    joint: JointKind
    name: str | None = None
    limits: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None
    sign: Literal[1, -1] = 1
    ratio: float = 1.0
    offset: float = 0.0
    speed: Annotated[float, Field(gt=0)] | None = None
    theta: float | None = None
    alpha: float | None = None
    a: float | None = None
    d: float | None = None
    beta: float | None = None

    @model_validator(mode="after")
    def _sensible(self) -> _Link:
        if self.limits is not None and not self.limits[0] < self.limits[1]:
            raise PydanticCustomError("limits", "'limits' must be [lower, upper] with lower < upper")
        if self.ratio == 0:
            raise PydanticCustomError("ratio", "'ratio' must not be zero: q_model = sign * ratio * reading + offset")
        return self


class _Calibration(Strict):
    errors: dict[str, float]
    sigmas: dict[str, float | None]
    covariance: list[list[float]]
    nominal_base: Frame
    nominal_tool: Frame
    provenance: dict[str, Any] = {}


class _RobotFile(Strict):
    schema_: Literal["symcal/robot/1"] = Field(default=SCHEMA, alias="schema")
    name: Annotated[str, Field(min_length=1)]
    convention: Convention
    units: _Units
    links: Annotated[list[_Link], Field(min_length=1)]
    base: Frame = Frame()
    tool: Frame = Frame()
    scales: dict[str, Annotated[float, Field(gt=0)]] = {}
    calibration: _Calibration | None = None


def load_robot(path: Path | str) -> Robot:
    """Read a robot file (nominal or calibrated).

    Raises:
        InputError: with file, line and key, for anything that is not as the schema says or cannot be.
    """
    document = read_document(path)
    file = validate(document, _RobotFile)
    length, angle = LENGTH[file.units.length], ANGLE[file.units.angle]
    names = [link.name or f"joint_{i}" for i, link in enumerate(file.links, start=1)]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise document.error("two joints have this name", ("links", i, "name"), found=name)
    links = tuple(_link(document, i, link, names[i], length, angle) for i, link in enumerate(file.links))
    robot = Robot(
        name=file.name,
        convention=file.convention,
        links=links,
        base=file.base.matrix(length, angle),
        tool=file.tool.matrix(length, angle),
    )
    scales = {}
    for name, value in file.scales.items():
        kind = name.rpartition("_")[0]
        if name not in robot.parameters:
            raise document.error(
                "no such link parameter", ("scales", name), found=name, allowed=robot.parameters
            )
        scales[name] = value * (angle if is_angle(kind) else length)
    return replace(robot, scales=scales, record=_record(document, file, length, angle))


def _link(document: Document, index: int, link: _Link, name: str, length: float, angle: float) -> Link:
    unit = angle if link.joint == "revolute" else length
    parameters = {}
    for kind in LINK_PARAMETERS:
        value: float | None = getattr(link, kind)
        if value is not None:
            parameters[kind] = value * (angle if is_angle(kind) else length)
            if is_angle(kind) and abs(parameters[kind]) > 4 * math.pi + 1e-9:
                message = "an angle of more than two turns: is it in the unit that 'units.angle' says?"
                raise document.error(message, ("links", index, kind), found=value)
    if link.joint == "revolute" and link.limits and max(map(abs, link.limits)) * angle > 200 * math.pi:
        message = "limits of more than a hundred turns: are they in the unit that 'units.angle' says?"
        raise document.error(message, ("links", index, "limits"), found=link.limits)
    lower, upper = (x * unit for x in link.limits) if link.limits else (-math.inf, math.inf)
    joint = Joint(
        kind=link.joint,
        name=name,
        lower=lower,
        upper=upper,
        sign=link.sign,
        ratio=link.ratio,
        offset=link.offset * unit,
        speed=None if link.speed is None else link.speed * unit,
    )
    return Link(joint, parameters)


def _record(document: Document, file: _RobotFile, length: float, angle: float) -> Record | None:
    c = file.calibration
    if c is None:
        return None
    n = len(c.errors)
    if len(c.covariance) != n or any(len(row) != n for row in c.covariance):
        raise document.error(f"the covariance must be {n} x {n}, one row per error", ("calibration", "covariance"))
    return Record(
        errors=c.errors,
        sigmas=c.sigmas,
        covariance=np.array(c.covariance).reshape(n, n),
        nominal_base=c.nominal_base.matrix(length, angle),
        nominal_tool=c.nominal_tool.matrix(length, angle),
        provenance=c.provenance,
    )


def save_robot(robot: Robot, path: Path | str, units: tuple[LengthUnit, AngleUnit] = ("mm", "deg")) -> None:
    """Write a robot file that `load_robot` reads back; errors, sigmas and covariance of a calibration stay in mm and rad.

    Raises:
        InputError: the file cannot be written.
    """
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
        data["scales"] = {
            name: value / (angle if is_angle(name.rpartition("_")[0]) else length)
            for name, value in robot.scales.items()
        }
    if robot.record is not None:
        data["calibration"] = {
            "errors": {k: float(v) for k, v in robot.record.errors.items()},
            "sigmas": {k: None if v is None else float(v) for k, v in robot.record.sigmas.items()},
            "covariance": robot.record.covariance.tolist(),
            "nominal_base": frame_entry(robot.record.nominal_base, length),
            "nominal_tool": frame_entry(robot.record.nominal_tool, length),
            "provenance": dict(robot.record.provenance),
        }
    try:
        write_document(path, data)
    except OSError as error:
        raise InputError(f"the file cannot be written: {error.strerror}", file=path) from None


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
