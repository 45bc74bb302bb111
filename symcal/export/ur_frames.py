"""The six frames of a Universal Robots arm, as `ur_description` and `ur_robot_driver` read them.

Each frame is the constant motion before a joint that turns about its z axis, in the frame behind the joint before; the
first in `base_link_inertia`, which stands where the controller's base stands. Angles are in the order of URDF,
R = Rz(yaw) Ry(pitch) Rx(roll).

Source: UniversalRobots/Universal_Robots_ROS2_Description, urdf/ur_macro.xacro (kinematics_params). Ours: numbers with
all digits, and a hash that is that of these numbers. The driver compares it with the controller's own and will say that
they differ: they do.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from symcal import spatial
from symcal.errors import RefusedError
from symcal.export.proof import link_poses
from symcal.export.urdf import roll_pitch_yaw
from symcal.robot.conventions import element, placements
from symcal.robot.robot import ELEMENTS, Robot

Array = NDArray[np.float64]

FILE = "ur_kinematics.yaml"
NAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_ANGLES = (90.0, 0.0, 0.0, 90.0, 90.0)
"""Between neighbouring axes, deg: what makes an arm one of this maker."""
_NEAR = 5.0  # deg: more is no calibration
_EXACT = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class URFrames:
    """frames: of the six joints, shape (6, 4, 4), mm. tcp: the tool in the flange (`tool0`), (4, 4), mm: what these six
    frames cannot hold of the last link is in it too."""

    frames: Array
    tcp: Array


def ur_frames(robot: Robot) -> URFrames:
    """The frames of a robot with its present numbers; joint terms are not in them.

    Raises:
        RefusedError: it is not built like an arm of this maker, a joint reads in another sense, or nothing says where
            its flange is.
    """
    _require_built_so(robot)
    motions = [[element(kind, axis, v) for kind, axis, v in _elements(robot, i)] for i in range(6)]
    if robot.convention == "craig":
        frames = [_product(parts) for parts in motions]
        flange = robot.nominal().tool
        if not np.allclose(flange[2, :2], 0, atol=_EXACT) or not np.allclose(flange[:2, 3], 0, atol=_EXACT):
            raise RefusedError(
                f"{robot.name} is described by joint axes and a tool, so that nothing says where its flange is: start "
                "from the arm's own table ('symcal init --arm ur5e') or the controller's calibration file"
            )
        frames[5] = frames[5] @ flange  # along and about its axis: on either side of the joint it is the same
        return URFrames(np.array(frames), spatial.inverse(flange) @ robot.tool)
    behind = [np.eye(4), *(_product(parts[2:]) for parts in motions)]
    frames = [before @ _product(parts[:2]) for before, parts in zip(behind, motions, strict=False)]
    return URFrames(np.array(frames), behind[6] @ robot.tool)


def ur_text(found: URFrames) -> str:
    """The frames as YAML, m and rad."""
    entries = {}
    for name, frame in zip(NAMES, found.frames, strict=True):
        values = (*(frame[:3, 3] * 1e-3).tolist(), *roll_pitch_yaw(frame[:3, :3]).tolist())
        entries[name] = dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), values, strict=True))
    digest = hashlib.sha256(repr(entries).encode()).hexdigest()[:20]
    lines = [
        "# kinematics written by symcal: m and rad, R = Rz(yaw) Ry(pitch) Rx(roll)",
        "# for ur_robot_driver's kinematics_params_file; the hash is not the controller's, and the driver will say so",
        "kinematics:",
    ]
    for name, entry in entries.items():
        lines += [f"  {name}:", *(f"    {axis}: {value!r}" for axis, value in entry.items())]
    return "\n".join([*lines, f"  hash: calib_{digest}", ""])


def ur_poses(folder: Path, q: Array, tcp: Array) -> Array:
    """T_base_tool by PyYAML and yourdfpy, from the file and a TCP; shape (n, 4, 4), mm."""
    read = yaml.safe_load((folder / FILE).read_text(encoding="utf-8"))["kinematics"]
    links = ["base_link", *NAMES]
    parts = [f'<link name="{link}"/>' for link in links]
    for name, parent in zip(NAMES, links, strict=False):
        at = read[name]
        xyz, rpy = (" ".join(repr(at[axis]) for axis in axes) for axes in ("xyz", ("roll", "pitch", "yaw")))
        parts.append(
            f'<joint name="{name}" type="continuous"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="{parent}"/>'
            f'<child link="{name}"/><axis xyz="0 0 1"/></joint>'
        )
    path = folder / "ur.urdf"
    path.write_text(f'<robot name="ur">{"".join(parts)}</robot>', encoding="utf-8")
    return link_poses(path, dict(zip(NAMES, q.T, strict=True)), NAMES[-1], "base_link") @ tcp


def tcp_text(tcp: Array) -> str | None:
    """What the TCP must be for the tool to be where the model says; None where it is the flange, to its last digit."""
    place, turned = np.round(tcp[:3, 3], 6) + 0.0, np.round(spatial.matrix_vectors(tcp[:3, :3]), 8) + 0.0
    if not place.any() and not turned.any():
        return None
    xyz = ", ".join(f"{v:.6f}" for v in place)
    turn = ", ".join(f"{v:.8f}" for v in turned)
    return f"the six frames end at the flange; the tool is there with the TCP ({xyz}) mm, rotation vector ({turn}) rad"


def _elements(robot: Robot, i: int) -> list[tuple[str, int, float]]:
    """The motions of a link in their order, the zero of its joint among them."""
    link = robot.links[i]
    moved = "theta" if link.joint.revolute else "d"
    return [
        (kind, axis, link.parameters.get(kind, 0.0) + (link.joint.offset if kind == moved else 0.0))
        for kind, axis in ELEMENTS[robot.convention]
    ]


def _product(parts: list[Array]) -> Array:
    found = np.eye(4)
    for part in parts:
        found = found @ part
    return found


def _require_built_so(robot: Robot) -> None:
    if robot.dof != 6 or not all(joint.revolute for joint in robot.joints):
        raise RefusedError(f"{robot.name} has not six revolute joints: these are the frames of Universal Robots arms")
    for joint in robot.joints:
        if joint.sign * joint.ratio != 1:
            raise RefusedError(
                f"joint {joint.name} reads {joint.sign * joint.ratio:g} times what it turns: these frames know no sign "
                "and no ratio"
            )
    axes, at = [], np.eye(4)
    for placement in placements(robot.nominal())[:6]:
        at = at @ placement
        axes.append(at[:3, 2])
    between = [np.degrees(np.arccos(min(abs(float(a @ b)), 1.0))) for a, b in pairwise(axes)]
    if any(abs(found - wanted) > _NEAR for found, wanted in zip(between, _ANGLES, strict=True)):
        raise RefusedError(
            f"{robot.name} is not built like an arm of Universal Robots (its axes stand "
            f"{', '.join(f'{angle:.0f}' for angle in between)} deg to each other): no driver reads such frames of it"
        )
