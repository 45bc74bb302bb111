"""A robot written in one of the formats that leave symcal, read back by another reader where there is one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from symcal.calibration.reasons import Reason
from symcal.errors import InputError
from symcal.export.c import export_c
from symcal.export.carries import LeftOut, check_carries, left_out, refuse_remainder
from symcal.export.corrections import COLUMNS, correction_rows
from symcal.export.gate import check_exportable
from symcal.export.joint_offsets import COLUMNS as OFFSET_COLUMNS
from symcal.export.joint_offsets import ROS, TABLE, TRANSMISSIONS, joint_offsets, offset_files, offset_poses
from symcal.export.json import json_text
from symcal.export.proof import Proof, proof
from symcal.export.ur_frames import FILE as UR_FILE
from symcal.export.ur_frames import tcp_text, ur_frames, ur_poses, ur_text
from symcal.export.urdf import text_of, urdf_poses
from symcal.export.xacro import PROPERTIES, ROBOT, xacro_files, xacro_poses
from symcal.outputs.csv_text import csv_text
from symcal.outputs.whole_file import require_own, write_all_whole
from symcal.robot.robot import Robot

FORMATS: Mapping[str, str] = {
    "c": "the C code",
    "urdf": "URDF",
    "xacro": "xacro",
    "ur": "a file of six frames",
    "offsets": "a table of zero offsets",
    "json": "JSON",
}
"""The formats, and what each is in a sentence."""

_MARKS = {
    "robot.urdf": b"kinematics written by symcal",
    PROPERTIES: b"kinematics written by symcal",
    ROBOT: b"kinematics written by symcal",
    UR_FILE: b"kinematics written by symcal",
    TABLE: ",".join(OFFSET_COLUMNS).encode(),
    ROS: b"joint offsets written by symcal",
    TRANSMISSIONS: b"joint offsets written by symcal",
    "robot.json": b'"schema": "symcal/robot-json/',
    "corrections.csv": ",".join(COLUMNS).encode(),
}
"""What tells a file of ours from somebody's of the same name."""


@dataclass(frozen=True, slots=True)
class Exported:
    """What an export wrote, the doubts that were overridden, what it could not carry of the joint terms, what another
    reader makes of the files (None of formats that bring their own check, or none), and what else is to be known."""

    written: Sequence[Path]
    doubts: Sequence[Reason]
    left_out: LeftOut | None = None
    proof: Proof | None = None
    notes: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class _Made:
    """Files that are still to be written, and what is known about them."""

    files: Mapping[str, str]
    left: LeftOut | None = None
    proof: Proof | None = None
    notes: Sequence[str] = ()


def export_robot(robot: Robot, to: str, folder: Path, *, force: bool = False, approximate: bool = False) -> Exported:
    """Write a robot in one of `FORMATS` into a folder.

    `c`: the folder `c`; `urdf`: `robot.urdf`; `xacro`: `calibration.xacro` and `robot.urdf.xacro`; `ur`:
    `ur_kinematics.yaml`; `offsets`: `joint_offsets.csv`, `joint_offsets.yaml` and `transmissions.xml`; `json`:
    `robot.json` and the table `corrections.csv`.

    Raises:
        RefusedError: a calibration that was refused or never judged, unless forced; joint terms that the format cannot
            carry, unless they may be left out; a smooth remainder; a robot that the format is not for; a file of these
            names that no export wrote: it is somebody's; another reader finds another robot in the files.
        InputError: the files cannot be written. Those that belong together are all written, or none.
    """
    overridden = check_exportable(robot, force)
    refuse_remainder(robot, FORMATS[to])
    if to == "c":
        _make(folder)
        return Exported([folder / "c"], overridden, export_c(robot, folder / "c", force=True).left_out)
    made = _made(robot, to, approximate)
    _make(folder)
    for name in made.files:
        require_own(folder / name, _MARKS[name])
    write_all_whole({folder / name: text for name, text in made.files.items()})
    return Exported([folder / name for name in made.files], overridden, made.left, made.proof, made.notes)


def _made(robot: Robot, to: str, approximate: bool) -> _Made:
    if to == "json":
        table = csv_text(correction_rows(robot), COLUMNS)
        return _Made({"robot.json": json_text(robot), "corrections.csv": table}, left_out(robot, "table"))
    if to == "offsets":
        found = joint_offsets(robot)
        files = offset_files(found)
        return _Made(
            files,
            proof=proof(found.robot, files, partial(offset_poses, nominal=found.nominal), ("yourdfpy",)),
            notes=(f"{found.text[0].upper()}{found.text[1:]}",),
        )
    left = check_carries(robot, "urdf", approximate)
    bare = robot if left is None else left.robot
    if to == "ur":
        frames = ur_frames(bare)
        files, tcp = {UR_FILE: ur_text(frames)}, tcp_text(frames.tcp)
        proven = proof(bare, files, partial(ur_poses, tcp=frames.tcp), ("yourdfpy",))
        return _Made(files, left, proven, () if tcp is None else (tcp,))
    text = text_of(bare, left)
    if to == "urdf":
        files = {"robot.urdf": text}
        return _Made(files, left, proof(bare, files, partial(urdf_poses, robot=bare), ("yourdfpy",)))
    files = xacro_files(text)
    return _Made(files, left, proof(bare, files, partial(xacro_poses, robot=bare), ("xacro", "yourdfpy")))


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"the folder cannot be made: {reason}", file=folder) from None
