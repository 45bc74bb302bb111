"""`symcal program`: a plan in, a program for a controller out."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from symcal.data.conditions import read_conditions
from symcal.documents.csv_file import read_table
from symcal.errors import InputError
from symcal.joints.backlash import direction_name
from symcal.outputs.whole_file import require_own, write_all_whole
from symcal.planning.plan_file import read_plan
from symcal.programs.languages import WRITTEN, program_files
from symcal.programs.visits import Array, visits
from symcal.robot.robot import Robot


def write_program(
    plan: Path,
    robot: Robot,
    to: str,
    folder: Path,
    *,
    name: str = "symcal_poses",
    percent: float = 20.0,
    settle: float = 1.0,
    approach: float = 0.0,
    wait: bool = False,
) -> list[Path]:
    """Write the program that drives to the poses of a plan.csv, and by columns `q3_direction` from where.

    Args:
        percent, settle, approach, wait: see `symcal.programs.visits.visits`.
    Raises:
        InputError: the plan cannot be read, the files not written. RefusedError: as `program_files`; a file of this
            name that is somebody else's.
    """
    poses, names = read_plan(plan, robot)
    drive = visits(
        robot,
        names,
        poses,
        percent=percent,
        settle=settle,
        wait=wait,
        approach=approach,
        directions=_directions(plan, robot, len(poses)),
    )
    files = program_files(to, name, drive)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder cannot be made: {error.strerror}", file=folder) from None
    for file in files:
        require_own(folder / file, b"pose,do,q1_" if to == "csv" else WRITTEN.encode())
    write_all_whole({folder / file: text for file, text in files.items()})
    return [folder / file for file in files]


def _directions(plan: Path, robot: Robot, count: int) -> Array | None:
    """In which every joint comes to every pose, -1, 0 or 1, shape (n, dof); None where the plan does not say."""
    table = read_table(plan)
    found = read_conditions(table, robot)
    ways = [found.get(direction_name(i)) for i in range(1, robot.dof + 1)]
    if all(way is None for way in ways) or len(table) != count:
        return None
    return np.column_stack([np.zeros(count) if way is None else way for way in ways])
