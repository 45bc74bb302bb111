"""Calibrations of Universal Robots, read only: the controller's `calibration.conf`, the six frames of `ur_calibration`.

`calibration.conf` has in `[mounting]` what is added to the nominal Denavit-Hartenberg parameters, m and rad. Its links
stand hundreds of metres from where they are, as axes 2 to 4 are nearly parallel; the robot is the same, written with
short links and beta (`symcal.robot.conventions.craig_robot`).

`ur_calibration` writes x, y, z, roll, pitch, yaw of six frames, m and rad: T = F_1 Rz(q_1) F_2 Rz(q_2) ... F_6 Rz(q_6).
Its angles are those of Eigen's `eulerAngles(0, 1, 2)`, R = Rx(roll) Ry(pitch) Rz(yaw); URDF, which reads the file
afterwards, takes them for Rz(yaw) Ry(pitch) Rx(roll).

Source: UniversalRobots/Universal_Robots_ROS2_Driver at 696e1a7, ur_calibration/src/calibration.cpp (`buildChain`,
`getSimplified`, `toYaml`) and ur_calibration/test/calibration_test.cpp.
"""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal import spatial
from symcal.documents.document import Strict, read_document, validate
from symcal.documents.read import MB, read_text
from symcal.documents.table import NUMBER
from symcal.errors import InputError
from symcal.robot.conventions import convert, craig_robot, element, placements
from symcal.robot.robot import Joint, Link, Robot
from symcal.words import number

Array = NDArray[np.float64]
Angles = Literal["ur_calibration", "urdf"]

FRAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
_DELTAS = {"delta_theta": "theta", "delta_a": "a", "delta_d": "d", "delta_alpha": "alpha"}
_MM = 1000.0
_OURS = "# kinematics written by symcal"
"""How the six frames begin that `symcal.export` writes."""
_POSTURES = 200
ANGLES: tuple[Angles, Angles] = ("ur_calibration", "urdf")


class _Frame(Strict):
    x: float
    y: float
    z: float
    roll: float
    pitch: float
    yaw: float


class _Kinematics(Strict):
    shoulder: _Frame
    upper_arm: _Frame
    forearm: _Frame
    wrist_1: _Frame
    wrist_2: _Frame
    wrist_3: _Frame
    hash: str = ""


class _SixFrames(Strict):
    kinematics: _Kinematics


def load_calibration_conf(path: Path | str, arm: Robot) -> Robot:
    """The robot of a controller's `calibration.conf`, with its nominal arm.

    Raises:
        InputError: not such a file, or the arm is none of six revolute joints in the standard convention.
    """
    path = Path(path)
    if arm.convention != "standard" or [joint.revolute for joint in arm.joints] != [True] * 6:
        message = "the deltas of a calibration.conf are those of an arm of Universal Robots, such as ur5e"
        raise InputError(message, key="--arm", found=arm.name)
    deltas = _mounting(path)
    links = []
    for i, link in enumerate(arm.links):
        own = {kind: link.parameters.get(kind, 0.0) + deltas[kind][i] for kind in deltas}
        links.append(Link(link.joint, own))
    far = replace(arm, links=tuple(links))
    return _short(f"{arm.name}_calibrated", arm.joints, placements(far), arm)


def load_six_frames(path: Path | str, angles: Angles | None = None, arm: Robot | None = None) -> Robot:
    """The robot of the six frames that `ur_calibration` writes.

    Args:
        angles: how roll, pitch and yaw are meant; see this file's head. None: as URDF reads them in a file of ours,
            which says so, and else as `ur_calibration` writes them. arm: whose joint names and limits are taken.
    Raises:
        InputError: not such a file, or an arm of other joints.
    """
    if arm is not None and [joint.revolute for joint in arm.joints] != [True] * 6:
        raise InputError("six frames are those of an arm of six revolute joints", key="--arm", found=arm.name)
    found = validate(read_document(path), _SixFrames).kinematics
    angles = angles or ("urdf" if read_text(path, MB).startswith(_OURS) else "ur_calibration")
    frames = []
    for name in FRAMES:
        own = getattr(found, name)
        rotation = _rotation(own.roll, own.pitch, own.yaw, angles)
        frames.append(spatial.transform(rotation, np.array([own.x, own.y, own.z]) * _MM))
    plain = tuple(Joint("revolute", name, -math.inf, math.inf) for name in _JOINTS)
    joints = plain if arm is None else arm.joints
    name = Path(path).stem if arm is None else f"{arm.name}_calibrated"
    return _short(name, joints, (*frames, np.eye(4)), arm)


def order_matters(path: Path | str) -> str:
    """How far the tool stands apart by the two ways to mean the angles of six frames, at most over random postures."""
    ours, urdf = (placements(load_six_frames(path, way)) for way in ANGLES)
    rng, apart = np.random.default_rng(0), 0.0
    for q in rng.uniform(-np.pi, np.pi, (_POSTURES, 6)):
        tools = []
        for chain in (ours, urdf):
            t = chain[0]
            for angle, next_ in zip(q, chain[1:], strict=True):
                t = t @ element("theta", 2, angle) @ next_
            tools.append(t[:3, 3])
        apart = max(apart, float(np.linalg.norm(tools[0] - tools[1])))
    return (
        f"roll, pitch, yaw of the frames as ur_calibration writes them, or as URDF reads them: {number(apart)} mm "
        f"apart at most in {_POSTURES} random postures (--angles)"
    )


def _short(name: str, joints: tuple[Joint, ...], chain: tuple[Array, ...], arm: Robot | None) -> Robot:
    """The chain with links as short as they are, in the standard convention, with what else the arm's file says."""
    bare = tuple(replace(joint, sign=1, ratio=1.0, offset=0.0) for joint in joints)
    robot = convert(craig_robot(name, bare, chain), "standard")
    turn, along = math.atan2(robot.tool[1, 0], robot.tool[0, 0]), float(robot.tool[2, 3])
    *others, last = robot.links
    own = {"theta": last.parameters["theta"] + turn, "d": along}
    screw = element("theta", 2, turn) @ element("d", 2, along)  # of the tool, which is a parameter of the last link
    robot = replace(robot, links=(*others, Link(last.joint, own)), tool=spatial.inverse(screw) @ robot.tool)
    return robot if arm is None else replace(robot, down=arm.down, masses=arm.masses, payload=arm.payload)


def _rotation(roll: float, pitch: float, yaw: float, angles: Angles) -> Array:
    if angles == "urdf":
        return spatial.rpy_matrix(np.array([roll, pitch, yaw]))
    x, y, z = (spatial.rpy_matrix(np.eye(3)[i] * angle) for i, angle in enumerate((roll, pitch, yaw)))
    return np.asarray(x @ y @ z)


def _mounting(path: Path) -> dict[str, tuple[float, ...]]:
    """The deltas by link parameter, mm and rad, shape (6,) each."""
    section, heads = "", set()
    found: dict[str, tuple[float, ...]] = {}
    for at, line in enumerate(read_text(path, MB).splitlines(), start=1):
        text = re.split(r"[#;]", line, maxsplit=1)[0].strip()
        head = re.fullmatch(r"\[\s*(\w+)\s*\]", text)
        if head:
            section = head[1].lower()
            heads.add(section)
            continue
        key, equals, value = (part.strip() for part in text.partition("="))
        if section != "mounting" or not equals or key not in _DELTAS:
            continue
        if _DELTAS[key] in found:
            raise InputError("this key stands here twice", file=path, line=at, key=key)
        cells = [cell.strip() for cell in value.removeprefix("[").removesuffix("]").split(",")]
        if len(cells) != 6 or not value.startswith("[") or not value.endswith("]"):
            message = "expected six numbers, one of each joint, in brackets"
            raise InputError(message, file=path, line=at, key=key, found=value)
        odd = next((cell for cell in cells if len(cell) > 40 or not NUMBER.fullmatch(cell)), None)
        if odd is not None or not all(abs(float(cell)) < 1e6 for cell in cells):
            raise InputError("not a finite number", file=path, line=at, key=key, found=odd or value)
        factor = _MM if _DELTAS[key] in ("a", "d") else 1.0
        found[_DELTAS[key]] = tuple(float(cell) * factor for cell in cells)
    if "mounting" not in heads:
        raise InputError("the file has no section [mounting]: is it a calibration.conf?", file=path)
    for key, kind in _DELTAS.items():
        if kind not in found:
            raise InputError("this key is missing in [mounting]", file=path, key=key, allowed=_DELTAS)
    return found
