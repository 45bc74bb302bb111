"""Plans as CSV files: one row per pose for the controller, and the waypoints of the whole motion.

plan.csv:       pose,q1_deg,q2_mm,...,segment,time_s     the segment (line, joint) leads to the pose and takes time_s
                pose,...,touches                         by name what the posture touches, where something is touched
waypoints.csv:  time_s,q1_deg,...,segment,pose           time since the start; pose is named where it is reached
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.data.saved_measurements import joint_columns
from symcal.documents.csv_file import read_table
from symcal.documents.table import joint_readings
from symcal.errors import InputError
from symcal.outputs.whole_file import write_whole
from symcal.planning.path import Path as Motion
from symcal.robot.robot import Robot

Array = NDArray[np.float64]


def write_plan(
    path: Path | str,
    robot: Robot,
    poses: Array,
    motion: Motion | None = None,
    *,
    names: Sequence[str] | None = None,
    touches: Sequence[str] | None = None,
) -> None:
    """Write the poses of a plan, shape (N, dof), in the order of the motion and with its segments if there is one.

    Args:
        names: of the poses; their numbers in ``poses``, from 1, when None. touches: what each of them touches.
    Raises:
        InputError: the file cannot be written.
    """
    order = range(len(poses)) if motion is None else [int(i) for i in motion.order]
    known = [str(i + 1) for i in range(len(poses))] if names is None else names
    rows = [[known[i], *_cells(robot, poses[i])] for i in order]
    header = ["pose", *joint_columns(robot)]
    if touches is not None:
        header.append("touches")
        rows = [[*row, touches[i]] for row, i in zip(rows, order, strict=True)]
    if motion is not None:
        header += ["segment", "time_s"]
        rows = [[*row, s.kind, repr(s.time)] for row, s in zip(rows, motion.segments, strict=True)]
    _write(Path(path), header, rows)


def write_waypoints(path: Path | str, robot: Robot, motion: Motion) -> None:
    """Write every waypoint of a motion; between rows the joints move linearly in time.

    Raises:
        InputError: the file cannot be written.
    """
    rows: list[list[str]] = []
    clock = 0.0
    for i, segment in zip(motion.order, motion.segments, strict=True):
        last = len(segment.waypoints) - 1
        for k, (q, time) in enumerate(zip(segment.waypoints, segment.times, strict=True)):
            if k > 0 or not rows:
                name = f"{int(i) + 1}" if k == last else ""
                rows.append([repr(clock + float(time)), *_cells(robot, q), segment.kind, name])
        clock += segment.time
    _write(Path(path), ["time_s", *joint_columns(robot), "segment", "pose"], rows)


def read_plan(path: Path | str, robot: Robot) -> tuple[Array, tuple[str, ...]]:
    """Poses of a CSV file, shape (N, dof), rad and mm, and their names (column `pose`, else 1, 2, ...).

    Any further columns are left alone: a measured set will do as well as a plan.

    Raises:
        InputError: with line and column for what cannot be read; a file without rows; a name twice.
    """
    table = read_table(path)
    if not len(table):
        raise InputError("the file has a header but no rows", file=path)
    poses = joint_readings(table, [(joint.name, joint.revolute) for joint in robot.joints])
    if "pose" not in table.columns:
        return poses, tuple(str(i + 1) for i in range(len(poses)))
    names = table.text("pose")
    first: dict[str, int] = {}
    for i, name in enumerate(names):  # several observations of one pose are one pose
        first.setdefault(name, i)
    start = np.array([first[name] for name in names])
    for i in np.flatnonzero(np.abs(poses - poses[start]).max(axis=1, initial=0.0) > 1e-9).tolist():
        message = f"this pose stands in line {table.lines[start[i]]} with other joint readings"
        raise InputError(message, file=path, line=table.lines[i], key="pose", found=names[i])
    kept = list(first.values())
    return poses[kept], tuple(names[i] for i in kept)


def _cells(robot: Robot, q: Array) -> list[str]:
    shown = np.where([joint.revolute for joint in robot.joints], np.rad2deg(q), q)
    return [repr(float(value)) for value in shown]


def _write(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_whole(path, text.getvalue())
