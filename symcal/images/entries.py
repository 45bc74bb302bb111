"""What an instrument of an experiment reads in images: of a printed board, or of discs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symcal.data.dataset import Dataset, Readings
from symcal.errors import InputError, RefusedError
from symcal.images.boards import MeasuredBoards, measure_boards
from symcal.images.examples import Example
from symcal.images.measure import MeasuredImages, measure_images
from symcal.images.shots import Shots
from symcal.model.observation import Observation
from symcal.robot.robot import Robot
from symcal.words import plural

Progress = Callable[[str], None]

_SAID = 5  # images that are named one by one among the warnings; results.json has all
_EXAMPLES = 4


@dataclass(frozen=True, slots=True)
class EntryImages:
    """What was measured for one entry of `measurements`: its name, what was found, how many images there were, and some
    of them."""

    name: str
    measured: MeasuredBoards | MeasuredImages
    given: int
    examples: tuple[Example, ...]

    @property
    def data(self) -> Dataset:
        return self.measured.data

    @property
    def facts(self) -> dict[str, Any]:
        """For results.json."""
        found = self.measured.found if isinstance(self.measured, MeasuredBoards) else None
        return {
            "given": self.given,
            "measured": len(self.data),
            "points": int(np.isfinite(self.data.z).sum()) // 2,
            "points_of_an_image": len(self.data.only.features),
            "failures": [{"image": name, "reason": reason} for name, reason in self.measured.failures],
            "notes": list(self.measured.notes),
            "where": self.measured.where,
            "agreement_mm": None if found is None else found.typical,
        }


def measure_entry(
    o: Observation, shots: Shots, robot: Robot, progress: Progress, examples: int = _EXAMPLES
) -> EntryImages:
    """The image points that an instrument with its target reads in images; what could not be measured is among the
    notes of its data.

    Raises:
        InputError: not a camera that looks at a board or at discs. RefusedError: nothing could be measured, or what is
            wrong makes all of it doubtful.
    """
    camera, board, marks = o.instrument.camera, o.target.board, o.target.marks
    if camera is None or (board is None and marks is None):
        message = "images are measured by 'instrument: pixels' with a camera, of a target with 'board' or 'file'"
        raise InputError(message)
    measured: MeasuredBoards | MeasuredImages
    if board is not None:
        measured = measure_boards(shots, robot, camera, board, progress=progress)
        _insist_on_mount(o, measured)
    else:
        assert marks is not None
        if o.at.moves or not o.target.at.moves:
            raise InputError("discs are measured by a camera beside the robot: one in the hand needs a board")
        known = o.at.frame if o.at.on == "world" and not o.at.unknown else None
        measured = measure_images(shots.shots, robot, camera, marks, T_world_camera=known, progress=progress)
    measured = replace(measured, failures=(*measured.failures, *shots.left))
    names = measured.data.only.features
    data = replace(measured.data, of=(Readings(o.instrument, o.name, names),), notes=_notes(measured))
    measured = replace(measured, data=data)
    return EntryImages(o.of, measured, len(shots.shots) + len(shots.left), _examples(measured, shots, examples))


def _insist_on_mount(o: Observation, measured: MeasuredBoards) -> None:
    found = measured.found
    if found is None or (found.mount == "hand") == o.at.moves:
        return
    words = {True: "in the robot's hand and the board is not", False: "beside the robot and the board is on it"}
    raise RefusedError(
        f"by its images the camera '{o.name}' is {words[found.mount == 'hand']}: the experiment says the contrary"
    )


def measured_head(measured: MeasuredBoards | MeasuredImages) -> tuple[str, ...]:
    """What is said in the head of a file of measured image points: what was not measured, and what should be known."""
    left = [f"not measured: {name}: {reason}" for name, reason in measured.failures]
    return (*left, *(f"note: {note}" for note in measured.notes))


def _notes(measured: MeasuredBoards | MeasuredImages) -> tuple[str, ...]:
    """What should be known, and the images that were not measured."""
    failures = measured.failures
    said = [f"not measured: {name}: {reason}" for name, reason in failures[:_SAID]]
    if len(failures) > _SAID:
        said.append(f"not measured: {plural(len(failures) - _SAID, 'image')} more, see results.json")
    return (*measured.notes, *said)


def _examples(measured: MeasuredBoards | MeasuredImages, shots: Shots, count: int) -> tuple[Example, ...]:
    """Images evenly among those that were measured."""
    load = {shot.name: shot.load for shot in shots.shots}
    chosen: Sequence[int] = sorted({int(i) for i in np.linspace(0, len(measured.images) - 1, count)}) if count else []
    return tuple(
        Example(measured.images[i], np.asarray(load[measured.images[i]]()), measured.detections[i].pixels, ())
        for i in chosen
    )
