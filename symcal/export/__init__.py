"""Ways out of Python: files for controllers and other programs, all in the base frame unless asked otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from symcal.errors import InputError
from symcal.export.c import export_c
from symcal.export.corrections import corrections
from symcal.export.gate import Doubt, check_exportable, doubts
from symcal.export.json import robot_json, save_json
from symcal.export.urdf import save_urdf
from symcal.robot.robot import Robot

FORMATS = ("c", "urdf", "json")

__all__ = [
    "FORMATS",
    "check_exportable",
    "corrections",
    "doubts",
    "export_c",
    "export_robot",
    "robot_json",
    "save_json",
    "save_urdf",
]


def export_robot(robot: Robot, to: str, folder: Path, *, force: bool = False) -> tuple[Sequence[Path], Sequence[Doubt]]:
    """Write a robot in one of `FORMATS` into a folder; returns what was written and the doubts that were overridden.

    `c`: the folder `c`; `urdf`: `robot.urdf`; `json`: `robot.json` and the table `corrections.csv`.

    Raises:
        RefusedError: a fit that did not converge or corrections that are implausibly large, unless forced.
        InputError: the files cannot be written.
    """
    overridden = check_exportable(robot, force)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder cannot be made: {error.strerror}", file=folder) from None
    if to == "c":
        export_c(robot, folder / "c")
        return [folder / "c"], overridden
    if to == "urdf":
        save_urdf(robot, folder / "robot.urdf")
        return [folder / "robot.urdf"], overridden
    save_json(robot, folder / "robot.json")
    corrections(robot).to_csv(folder / "corrections.csv", index=False)
    return [folder / "robot.json", folder / "corrections.csv"], overridden
