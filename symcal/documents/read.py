"""Every input file comes in here: an ordinary file, of a size that can be read, or one clear error."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

from symcal.errors import InputError

MB = 2**20

DOCUMENT_LIMIT = 4 * MB
"""Bytes of a YAML or JSON file: a calibration of 200 parameters with its covariance has 1 MB. Ours, like all limits."""

TABLE_LIMIT = 64 * MB
"""Bytes of a CSV file."""

CONTROL = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\x7f-\x84\x86-\x9f\u202a-\u202e\u2066-\u2069]")
"""Characters that steer a terminal, or show a text in another order than it has; no name here needs one."""

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def read_bytes(path: Path | str, limit: int, what: str = "file") -> bytes:
    """The content of an ordinary file; links are followed.

    Args:
        limit: bytes; of a longer file nothing is kept. what: the file in a word, for messages.
    Raises:
        InputError: no such file, no permission, a pipe, device, socket or folder (none of which is waited for), or more
        bytes than the limit.
    """
    path = Path(path)
    try:
        # opened without waiting for a writer, and asked afterwards: what was asked is what is read
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with os.fdopen(handle, "rb") as file:
            facts = os.fstat(file.fileno())
            if stat.S_ISREG(facts.st_mode) and facts.st_size <= limit:
                content = file.read(limit + 1)  # a file may grow meanwhile
                if len(content) <= limit:
                    return content
    except FileNotFoundError:
        raise InputError(f"there is no such {what}", file=path) from None
    except OSError as error:
        raise _unreadable(path, error, what) from None
    except ValueError as error:
        raise InputError(f"the {what} cannot be read: {error}", file=path) from None
    for holds, kind in _KINDS:
        if holds(facts.st_mode):
            raise InputError(f"this is {kind}: an ordinary file is needed", file=path)
    raise InputError(f"the {what} is too large: at most {limit // MB} MB are read", file=path)


def _unreadable(path: Path, error: OSError, what: str) -> InputError:
    """A folder cannot be opened on Windows, and a socket nowhere: the system's own words do not say so."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        mode = 0
    for holds, kind in _KINDS:
        if holds(mode):
            return InputError(f"this is {kind}: an ordinary file is needed", file=path)
    return InputError(f"the {what} cannot be read: {error.strerror}", file=path)


def read_text(path: Path | str, limit: int, encoding: str = "utf-8") -> str:
    """The text of an ordinary file, its line ends as they are.

    Raises:
        InputError: as `read_bytes`, or not UTF-8.
    """
    try:
        return read_bytes(path, limit).decode(encoding)
    except UnicodeDecodeError as error:
        raise InputError(f"the file cannot be read as UTF-8 text: {error}", file=path) from None
