"""The first files of a calibration, written into a folder that has none of them."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from symcal.drafts.cell import cell
from symcal.drafts.experiment import experiment_text
from symcal.drafts.instrument import Draft
from symcal.drafts.robot_file import RobotDraft
from symcal.errors import InputError, RefusedError
from symcal.outputs.names import file_name
from symcal.outputs.whole_file import write_all_whole

MARK = "FILL IN"
"""Stands at every number that is a guess."""

_CAMERA = """\
# A camera as its data sheet might have it. 'symcal camera' finds the numbers of yours: see experiment.yaml.
schema: symcal/camera/1
units: {image: px}
width: 1280                           # FILL IN
height: 720                           # FILL IN
lens: {focal_mm: 3.7, pixel_um: 4}    # FILL IN: focal length and side of a pixel
"""


@dataclass(frozen=True, slots=True)
class Written:
    """files: written, in the order to look at them. guesses: how many lines of them are marked as such."""

    files: tuple[Path, ...]
    guesses: int


def first_name(robot: RobotDraft, draft: Draft) -> str:
    """What the experiment is called, and the folder where no other is named."""
    return file_name(f"{file_name(robot.robot.name)}_{draft.name}")


def write_first_files(robot: RobotDraft, draft: Draft, folder: Path) -> Written:
    """Write robot.yaml, experiment.yaml and the table, and camera.yaml where one is used.

    Raises:
        RefusedError: one of them is there already. InputError: they cannot be written.
    """
    names = ["experiment.yaml", "robot.yaml", *(["camera.yaml"] if draft.images else []), draft.table]
    there = [name for name in names if os.path.lexists(folder / name)]
    if there:
        raise RefusedError(f"{folder / there[0]} is there already, and nothing is replaced: choose another --out")
    text = experiment_text(robot.robot, robot.title, draft, cell(robot.robot, draft), first_name(robot, draft))
    contents = {
        "experiment.yaml": text,
        "robot.yaml": robot.text,
        "camera.yaml": _CAMERA,
        draft.table: ",".join(draft.columns(robot.robot)) + "\n",
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder cannot be made: {error.strerror}", key="--out", found=folder) from None
    write_all_whole({folder / name: contents[name] for name in names})
    marked = sum(contents[name].count(f"# {MARK}") for name in names)
    return Written(tuple(folder / name for name in names), marked)
