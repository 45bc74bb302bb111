"""A robot written in one of the formats that leave symcal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from symcal.calibration.reasons import Reason
from symcal.errors import InputError
from symcal.export.c import export_c
from symcal.export.carries import LeftOut, check_carries, left_out, refuse_remainder
from symcal.export.corrections import COLUMNS, correction_rows
from symcal.export.gate import check_exportable
from symcal.export.json import json_text
from symcal.export.urdf import save_urdf
from symcal.outputs.csv_text import csv_text
from symcal.outputs.whole_file import require_own, write_all_whole
from symcal.robot.robot import Robot

FORMATS = ("c", "urdf", "json")


@dataclass(frozen=True, slots=True)
class Exported:
    """What an export wrote, the doubts that were overridden, and what it could not carry of the joint terms."""

    written: Sequence[Path]
    doubts: Sequence[Reason]
    left_out: LeftOut | None = None


def export_robot(robot: Robot, to: str, folder: Path, *, force: bool = False, approximate: bool = False) -> Exported:
    """Write a robot in one of `FORMATS` into a folder.

    `c`: the folder `c`; `urdf`: `robot.urdf`; `json`: `robot.json` and the table `corrections.csv`.

    Raises:
        RefusedError: a calibration that was refused or never judged, unless forced; joint terms that the format cannot
            carry, unless they may be left out; a smooth remainder; a file of these names that no export wrote: it is
            somebody's.
        InputError: the files cannot be written. Two that belong together are both written, or none.
    """
    overridden = check_exportable(robot, force)
    refuse_remainder(robot, {"c": "the C code", "urdf": "URDF", "json": "JSON"}[to])
    if to == "urdf" and not approximate:
        check_carries(robot, "urdf")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"the folder cannot be made: {reason}", file=folder) from None
    if to == "c":
        written, left = [folder / "c"], export_c(robot, folder / "c", force=True).left_out
    elif to == "urdf":
        written = [folder / "robot.urdf"]
        require_own(written[0], b"kinematics written by symcal")
        left = save_urdf(robot, written[0], approximate=approximate, force=True)
    else:
        written = [folder / "robot.json", folder / "corrections.csv"]
        table = correction_rows(robot)
        require_own(written[0], b'"schema": "symcal/robot-json/')
        require_own(written[1], ",".join(COLUMNS).encode())
        write_all_whole({written[0]: json_text(robot), written[1]: csv_text(table, COLUMNS)})
        left = left_out(robot, "table")
    return Exported(written, overridden, left)
