"""Trajectories in the formats of TUM and EuRoC, with a CSV file of joint readings beside them, matched by time.

TUM: `timestamp tx ty tz qx qy qz qw`, s and m, parted by spaces. EuRoC: `timestamp, p_x, p_y, p_z, q_w, q_x, q_y, q_z,
...`, ns and m, parted by commas. Lines that begin with '#' say nothing. The joint file has a column `t_s` beside those
of the joints.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from symcal.documents.csv_file import read_table
from symcal.documents.read import TABLE_LIMIT, read_text
from symcal.documents.table import NUMBER, Table, joint_readings
from symcal.errors import InputError
from symcal.readers.streams import Joints, Matching, Stream, matched, stream

_TIMES = {"t_s": 1.0, "t_ms": 1e-3, "t_us": 1e-6}


def read_trajectory(path: Path, joints: Path, of: Joints, how: Matching) -> Table:
    """The poses of a trajectory with the joint readings beside them, see `symcal.readers.streams.matched`.

    Raises:
        InputError: a line that is none of either format, a joint file without times or joints, or recordings that do
        not go together.
    """
    return matched(_recorded(joints, of), _trajectory(path), of, how)


def _trajectory(path: Path) -> Stream:
    lines = read_text(path, TABLE_LIMIT, "utf-8-sig").splitlines()
    kept = [(number, line) for number, line in enumerate(lines, start=1) if line.strip() and line.strip()[0] != "#"]
    if not kept:
        raise InputError("the file has no poses", file=path)
    euroc = "," in kept[0][1]
    name, form = (
        ("EuRoC", "timestamp [ns], x, y, z, q_w, q_x, q_y, q_z, ...")
        if euroc
        else ("TUM", "timestamp tx ty tz qx qy qz qw")
    )
    rows = []
    for number, line in kept:
        cells = [cell.strip() for cell in line.split(",")] if euroc else line.split()
        if len(cells) < 8 or (len(cells) > 8 and not euroc):
            message = f"a line of a {name} trajectory is '{form}'"
            raise InputError(message, file=path, line=number, found=f"{len(cells)} cells")
        odd = next((cell for cell in cells[:8] if len(cell) > 40 or not NUMBER.fullmatch(cell)), None)
        if odd is not None:
            message = f"not a finite number, where a {name} trajectory has '{form}'"
            raise InputError(message, file=path, line=number, found=odd)
        # ns since 1970 have more digits than a float
        t = int(cells[0]) * 1e-9 if euroc and cells[0].isdecimal() else float(cells[0]) * (1e-9 if euroc else 1.0)
        pose = [float(cell) for cell in cells[1:8]]
        if euroc:
            pose = [*pose[:3], *pose[4:], pose[3]]
        if abs(math.hypot(*pose[3:]) - 1) > 1e-3:
            message = f"the quaternion of a {name} trajectory ('{form}') is not of unit length"
            raise InputError(message, file=path, line=number, found=f"{math.hypot(*pose[3:]):.6g}")
        rows.append([t, *pose])
    numbers = np.array(rows)
    return stream(path, "", numbers[:, 0], numbers[:, 1:], measured=True)


def _recorded(path: Path, of: Joints) -> Stream:
    table = read_table(path, decimal=None)
    if not len(table):
        raise InputError("the file has a header but no rows", file=path)
    given = [name for name in table.columns if name in _TIMES]
    if len(given) != 1:
        message = "the file needs one column with the time of each joint reading"
        raise table.error(message, found=", ".join(table.columns), allowed=_TIMES)
    t = table.numbers(given[0]) * _TIMES[given[0]]
    return stream(path, "", t, joint_readings(table, of), table.notes)
