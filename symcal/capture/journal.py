"""What happened in a capture, line by line: a file that is only ever appended to, and that any moment may interrupt.

Each line is one event as JSON, or a list of those that only hold together, on the disk before anything follows from it.
A line that a crash has cut off was never acknowledged and is taken away when the journal is opened again; everything
before it holds.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from symcal.errors import InputError, RefusedError
from symcal.outputs.locks import try_lock
from symcal.outputs.whole_file import flush, flush_path

JOURNAL = "journal.jsonl"
SCHEMA = "symcal/capture/1"
Event = Mapping[str, Any]


class Journal:
    """The open journal of one capture; made by `opened`."""

    def __init__(self, path: Path, descriptor: int, events: list[Event]) -> None:
        self.path = path
        self.events = events
        self._descriptor = descriptor

    def add(self, *events: Event) -> None:
        """Append events that hold together; they are on the disk when this returns.

        Raises:
            InputError: the disk is full, or the file cannot be written.
        """
        content = events[0] if len(events) == 1 else events
        line = json.dumps(content, ensure_ascii=False, allow_nan=False).encode() + b"\n"
        try:
            rest = memoryview(line)
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
            flush(self._descriptor)
        except OSError as error:
            raise InputError(f"the journal cannot be written: {error.strerror}", file=self.path) from None
        self.events.extend(events)


@contextmanager
def opened(folder: Path) -> Iterator[Journal]:
    """The journal in a folder, which is made if it is not there; no other process may have it meanwhile.

    Raises:
        RefusedError: another process captures into this folder. InputError: it cannot be used, or is none of ours.
    """
    path = folder / JOURNAL
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_CREAT | os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o666)
    except OSError as error:
        raise InputError(f"the session cannot be used: {error.strerror}", file=path) from None
    try:
        if try_lock(descriptor) is False:
            raise RefusedError(f"another capture writes into {folder}: end that one, or choose another --out")
        events = _read(path, descriptor)
        flush_path(folder)
        yield Journal(path, descriptor, events)
    finally:
        os.close(descriptor)


def _read(path: Path, descriptor: int) -> list[Event]:
    """All events; what stands behind the last whole line is cut off."""
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.ftruncate(descriptor, whole)
        flush(descriptor)
    events: list[Event] = []
    for number, line in enumerate(content[:whole].splitlines(), start=1):
        try:
            told = json.loads(line)
        except ValueError:
            told = None
        for event in told if isinstance(told, list) else [told]:
            if not isinstance(event, dict) or "event" not in event:
                message = "this line is no event of a capture: the file was changed by hand"
                raise InputError(message, file=path, line=number)
            events.append(event)
    if events and events[0].get("schema") != SCHEMA:
        raise InputError(
            "this journal is of another version", file=path, line=1, found=events[0].get("schema"), allowed=(SCHEMA,)
        )
    return events
