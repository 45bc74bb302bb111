"""What a robot file may say: its keys, their types, and the slips that can be told from the numbers.

Angles and lengths here are still in the file's units; `symcal.robot.robot` converts them.
"""

import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from symcal import spatial
from symcal.documents.document import Document, Key, Strict, read_document, validate
from symcal.parameters import link_name
from symcal.robot.provenance import Provenance
from symcal.robot.terms import Physics, PhysicsEntries
from symcal.units import ANGLE, LENGTH, AngleUnit, LengthUnit
from symcal.words import is_term_number

Array = NDArray[np.float64]
Convention = Literal["standard", "craig"]
JointKind = Literal["revolute", "prismatic"]

LINK_PARAMETERS = ("theta", "alpha", "a", "d", "beta")
"""The kinds of link parameters, in the order of the parameter vector ([Ding2017] eq. 3)."""

TURN = 2 * math.pi
SCHEMA: Literal["symcal/robot/1"] = "symcal/robot/1"


def is_angle(parameter: str) -> bool:
    """Whether a link parameter is an angle (rad) rather than a length (mm)."""
    return parameter in ("theta", "alpha", "beta")


class RobotUnits(Strict):
    length: LengthUnit
    angle: AngleUnit


def _given(value: Any) -> Any:
    if value is None:
        raise PydanticCustomError("empty", "nothing stands behind this key: give a value or leave the key out")
    return value


def _rising(limits: list[float]) -> list[float]:
    if not limits[0] < limits[1]:
        raise PydanticCustomError("limits", "limits are [lower, upper] with lower < upper")
    return limits


def _not_zero(ratio: float) -> float:
    if ratio == 0:
        raise PydanticCustomError("ratio", "must not be zero: q_model = sign * ratio * reading + offset")
    return ratio


def _unit(quaternion: list[float]) -> list[float]:
    if abs(math.hypot(*quaternion) - 1) > 1e-3:
        raise PydanticCustomError("quaternion", "must be a unit quaternion (x, y, z, w)")
    return quaternion


_Positive = Annotated[float, Field(gt=0)]
_Pair = Annotated[list[float], Field(min_length=2, max_length=2), AfterValidator(_rising)]
_Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
_Quaternion = Annotated[list[float], Field(min_length=4, max_length=4), AfterValidator(_unit)]
_Number = Annotated[float | None, BeforeValidator(_given)]  # may be left out, but not left empty


class Frame(Strict):
    """A frame in a file: `{xyz, rpy}` (R = Rz(yaw) Ry(pitch) Rx(roll)) or `{xyz, quat_xyzw}`."""

    xyz: _Triple = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    rpy: Annotated[_Triple | None, BeforeValidator(_given)] = None
    quat_xyzw: Annotated[_Quaternion | None, BeforeValidator(_given)] = None

    @model_validator(mode="after")
    def _one_rotation(self) -> Self:
        if self.rpy is not None and self.quat_xyzw is not None:
            raise PydanticCustomError("frame", "a frame has 'rpy' or 'quat_xyzw', not both")
        return self

    def matrix(self, length: float, angle: float) -> Array:
        """T (4, 4) in mm; length and angle are mm and rad per unit of the file."""
        if self.quat_xyzw is not None:
            rotation = spatial.quaternion_matrices(np.asarray(self.quat_xyzw))
        else:
            rotation = spatial.rpy_matrix(np.asarray(self.rpy or [0.0, 0.0, 0.0]) * angle)
        return spatial.transform(rotation, np.asarray(self.xyz) * length)


class LinkEntry(Strict):
    joint: JointKind
    name: Annotated[str | None, Field(min_length=1), BeforeValidator(_given)] = None
    limits: Annotated[_Pair | None, BeforeValidator(_given)] = None
    sign: Literal[1, -1] = 1
    ratio: Annotated[float, AfterValidator(_not_zero)] = 1.0
    offset: float = 0.0
    speed: Annotated[_Positive | None, BeforeValidator(_given)] = None
    theta: _Number = None
    alpha: _Number = None
    a: _Number = None
    d: _Number = None
    beta: _Number = None


class CalibrationEntry(Strict):
    errors: dict[str, float]
    sigmas: dict[str, float | None]
    covariance: list[list[float]]
    nominal_base: Frame
    nominal_tool: Frame
    provenance: Provenance = Provenance.model_construct()


class RobotFile(PhysicsEntries):
    schema_: Literal["symcal/robot/1"] = Field(default=SCHEMA, alias="schema")
    name: Annotated[str, Field(min_length=1)]
    convention: Convention
    units: RobotUnits
    links: Annotated[list[LinkEntry], Field(min_length=1)]
    base: Frame = Frame.model_construct()
    tool: Frame = Frame.model_construct()
    scales: dict[str, _Positive] = Field(default_factory=dict)
    calibration: Annotated[CalibrationEntry | None, BeforeValidator(_given)] = None

    @property
    def joint_names(self) -> list[str]:
        return [link.name or f"joint_{i}" for i, link in enumerate(self.links, start=1)]

    @property
    def link_parameters(self) -> list[str]:
        entries = list(enumerate(self.links, start=1))
        return [
            link_name(kind, i) for kind in LINK_PARAMETERS for i, link in entries if getattr(link, kind) is not None
        ]


def read_robot_file(path: Path | str) -> tuple[RobotFile, Physics]:
    """A robot file as it stands, and what it says beyond geometry in mm and rad, checked.

    Raises:
        InputError: with file, line and key, for anything that is not as the schema says or cannot be.
    """
    document = read_document(path)
    file = validate(document, RobotFile)
    _check_names(document, file.joint_names)
    joints = [(name, link.joint == "revolute") for name, link in zip(file.joint_names, file.links, strict=True)]
    physics = file.read(document, joints, LENGTH[file.units.length], ANGLE[file.units.angle])
    names = [*file.link_parameters, *(p.name for term in physics.terms for p in term.parameters)]
    if file.calibration is None:  # an identified angle is what it is
        _check_angles(document, file)
    else:
        _check_calibration(document, file.calibration, names)
    for name in file.scales:
        if name not in names:
            raise document.error("no such parameter", ("scales", name), found=name, allowed=names)
    return file, physics


def _check_names(document: Document, names: list[str]) -> None:
    for i, name in enumerate(names):
        if name in names[:i]:
            raise document.error("two joints have this name", ("links", i, "name"), found=name)
        if re.fullmatch(r"q[0-9]+", name) and name != f"q{i + 1}":
            message = f"a column of this name belongs to joint {name[1:]}: choose another"
            raise document.error(message, ("links", i, "name"), found=name)


def _check_angles(document: Document, file: RobotFile) -> None:
    """Refuse angles that were evidently written in another unit than the file says."""
    angle = ANGLE[file.units.angle]
    listed: list[tuple[Key, float]] = []
    for i, link in enumerate(file.links):
        listed += [(("links", i, kind), getattr(link, kind) or 0.0) for kind in LINK_PARAMETERS if is_angle(kind)]
        if link.joint == "revolute" and link.limits and max(map(abs, link.limits)) * angle > 10 * TURN:
            message = "limits beyond ten turns: are they in the unit that 'units.angle' says? (endless: no limits)"
            raise document.error(message, ("links", i, "limits"), found=link.limits)
    for name, frame in (("base", file.base), ("tool", file.tool)):
        listed += [((name, "rpy", i), value) for i, value in enumerate(frame.rpy or ())]
    for key, value in listed:
        if abs(value) * angle > 2.001 * TURN:
            message = "an angle of more than two turns: is it in the unit that 'units.angle' says?"
            raise document.error(message, key, found=value)
        quarters = round(value / (TURN / 4))
        if file.units.angle == "deg" and 1 <= abs(quarters) <= 4 and abs(value - quarters * TURN / 4) < 3e-4:
            message = f"this looks like {90 * quarters} deg written in rad, but 'units.angle' is deg"
            raise document.error(message, key, found=value)


def _check_calibration(document: Document, calibration: CalibrationEntry, parameters: list[str]) -> None:
    for name in calibration.errors:
        of_robot = name.rpartition("_")[0] in LINK_PARAMETERS or is_term_number(name)
        if of_robot and name not in parameters:
            key: Key = ("calibration", "errors", name)
            raise document.error("no such parameter", key, found=name, allowed=parameters)
    n = len(calibration.errors)
    if [len(row) for row in calibration.covariance] != [n] * n:
        raise document.error(f"the covariance must be {n} x {n}, one row per error", ("calibration", "covariance"))
    _check_finite(document, calibration.provenance.facts, ("calibration", "provenance"))
    for name in calibration.sigmas:
        if name not in calibration.errors:
            key = ("calibration", "sigmas", name)
            raise document.error("no error has this name", key, found=name, allowed=calibration.errors)


def _check_finite(document: Document, value: object, key: Key) -> None:
    """What no schema looks at has no NaN and no infinity either: JSON, which it is handed on in, has none."""
    if isinstance(value, float) and not math.isfinite(value):
        raise document.error("the number must be finite", key, found=value)
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, inside in items:
        _check_finite(document, inside, (*key, name))
