"""The folder of a capture: its journal, the measurements as a table, and an experiment that identifies them.

journal.jsonl       every event, appended and flushed before anything follows from it
measurements.csv    all readings, made anew from the journal after each of them; those that do not count are `unused`
session.yaml        the experiment of the plan on these measurements: `symcal identify session.yaml`
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.capture.aim import Aim
from symcal.capture.course import Course, Wanted, course_of
from symcal.capture.estimate import dataset
from symcal.capture.journal import SCHEMA, Event, Journal, opened
from symcal.config import conversion as config
from symcal.data.saved_measurements import save_measurements
from symcal.documents.document import write_document
from symcal.errors import InputError, RefusedError

Array = NDArray[np.float64]

MEASUREMENTS, EXPERIMENT = "measurements.csv", "session.yaml"


@dataclass(slots=True)
class Session:
    """An open capture; made by `opened_session`."""

    folder: Path
    aim: Aim
    journal: Journal
    course: Course = field(default_factory=Course)

    def add(self, *events: Event) -> None:
        """Keep events that hold together: they are on the disk when this returns, and the table is as they say.

        Raises:
            InputError: the disk is full, or a file cannot be written.
        """
        if not events:
            return
        self.journal.add(*events)
        for event in events:
            self.course = self.course.after(event)
        self.write()

    def write(self) -> None:
        """Write the table as the journal has it; nothing where nothing was read.

        Raises:
            InputError: it cannot be written.
        """
        readings = self.course.readings
        if readings:
            head = [f"pose {each.pose}: {each.why}" for each in readings if each.why]
            save_measurements(dataset(self.aim, readings), self.aim.experiment.robot, self.folder / MEASUREMENTS, head)

    def read(self, wanted: Wanted, q: Array, z: Array, directions: Array, source: str = "") -> None:
        """Keep a reading, before it is looked at. Args: source: the file that it is from."""
        self.add(
            {
                "event": "reading",
                "number": self.course.last + 1,
                "pose": wanted.pose,
                "asked": wanted.asked,
                "beside": wanted.beside,
                "since": wanted.since,
                "q": q.tolist(),
                "z": [float(value) if np.isfinite(value) else None for value in z],
                "from": directions.tolist(),
                "source": source,
            }
        )

    @property
    def sources(self) -> frozenset[str]:
        """Files that readings are from."""
        return frozenset(str(event["source"]) for event in self.journal.events if event.get("source"))

    def missed(self, wanted: Wanted, why: str) -> None:
        """Keep that nothing could be read."""
        self.add({"event": "missed", "number": self.course.last + 1, "pose": wanted.pose, "why": why})


@contextmanager
def opened_session(folder: Path, aim: Aim) -> Iterator[Session]:
    """The capture in a folder, begun or gone on with.

    Raises:
        RefusedError: another process has it, or it is of another plan. InputError: it cannot be used.
    """
    with opened(folder) as journal:
        of = {"experiment": _hash([aim.experiment.document.path, aim.experiment.robot_path]), "plan": _hash([aim.plan])}
        if not journal.events:
            _refuse_foreign(folder)
            journal.add({"event": "begin", "schema": SCHEMA, **of})
        begun = journal.events[0]
        for key, value in of.items():
            if begun.get(key) != value:
                raise RefusedError(
                    f"{folder} was begun with another {key}: go on with that one, or choose another --out for this"
                )
        session = Session(folder, aim, journal, course_of(journal.events))
        write_document(folder / EXPERIMENT, _experiment(aim, folder))
        session.write()  # which a killed capture may not have come to
        yield session


def _refuse_foreign(folder: Path) -> None:
    """A new capture begins in an empty folder, or in one that is not there."""
    others = sorted(path.name for path in folder.iterdir() if path.name != "journal.jsonl")
    if others:
        (folder / "journal.jsonl").unlink()
        raise RefusedError(f"{folder} holds other files ({others[0]}): choose another --out")


def _experiment(aim: Aim, folder: Path) -> Mapping[str, Any]:
    """The experiment with the measurements of this session, as it can be run from the folder."""
    own = aim.experiment
    data = config.resolved(own.file, own.document, folder)
    for entry in data.get("measurements", {}).values():
        entry.pop("data", None)
    data["seed"] = own.seed
    data["data"] = {
        "source": "file",
        "file": MEASUREMENTS,
        "split": {"column": "split", "train": ["train"], "test": ["test"]},
    }
    return data


def _hash(paths: Iterable[Path]) -> str:
    found = hashlib.sha256()
    for path in paths:
        try:
            found.update(path.read_bytes())
        except OSError as error:
            raise InputError(f"the file cannot be read: {error.strerror}", file=path) from None
    return found.hexdigest()[:16]
