"""Every input file comes in here: an ordinary file, of a size that can be read, or one clear error."""

from __future__ import annotations

import os
import re
import stat
from codecs import getincrementaldecoder
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from symcal.errors import InputError

MB = 2**20

DOCUMENT_LIMIT = 4 * MB
"""Bytes of a YAML or JSON file: a calibration of 200 parameters with its covariance has 1 MB. Ours, like all limits."""

TABLE_LIMIT = 1024 * MB
"""Bytes of a CSV file: a million rows of twenty columns, each number with all its digits, have 400 MB."""

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
    with _opened(Path(path), limit, what) as file:
        content = file.read(limit + 1)  # a file may grow meanwhile
    if len(content) > limit:
        raise _too_large(Path(path), limit, what)
    return content


def read_pieces(path: Path | str, limit: int, piece: int) -> Iterator[str]:
    """The text of an ordinary file in pieces that end where a line ends; ``piece`` bytes or a few more are held.

    Lines end with a line feed, whatever they end with in the file; a byte order mark is passed over.

    Raises:
        InputError: as `read_bytes`, or not UTF-8, or a line is longer than a piece.
    """
    path = Path(path)
    decoder, kept, count = getincrementaldecoder("utf-8-sig")(), "", 0
    with _opened(path, limit, "file") as file:
        while True:
            new = file.read(piece)
            before = count - len(decoder.getstate()[0])
            count += len(new)
            if count > limit:  # a file may grow meanwhile
                raise _too_large(path, limit, "file")
            try:
                text = kept + decoder.decode(new, final=not new)
            except UnicodeDecodeError as error:
                what = f"byte {error.object[error.start]:#04x} in position {before + error.start}: {error.reason}"
                raise InputError(f"the file cannot be read as UTF-8 text: {what}", file=path) from None
            cut = _whole_lines(text) if new else len(text)
            if cut:
                yield text[:cut].replace("\r\n", "\n").replace("\r", "\n")
            elif len(text) > piece:
                raise InputError(f"a line of more than {piece} bytes: is this a table?", file=path)
            if not new:
                return
            kept = text[cut:]


def _whole_lines(text: str) -> int:
    """Characters of whole lines; a carriage return at the very end may be half of an end."""
    return text.rfind("\n") + 1 or text.rfind("\r", 0, len(text) - 1) + 1


@contextmanager
def _opened(path: Path, limit: int, what: str) -> Iterator[IO[bytes]]:
    """An ordinary file of at most so many bytes, to be read."""
    try:
        # opened without waiting for a writer, and asked afterwards: what was asked is what is read
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with os.fdopen(handle, "rb") as file:
            facts = os.fstat(file.fileno())
            if not stat.S_ISREG(facts.st_mode):
                raise _no_file(path, facts.st_mode)
            if facts.st_size > limit:
                raise _too_large(path, limit, what)
            yield file
    except FileNotFoundError:
        raise InputError(f"there is no such {what}", file=path) from None
    except OSError as error:
        raise _unreadable(path, error, what) from None
    except ValueError as error:
        raise InputError(f"the {what} cannot be read: {error}", file=path) from None


def _too_large(path: Path, limit: int, what: str) -> InputError:
    return InputError(f"the {what} is too large: at most {limit // MB} MB are read", file=path)


def _no_file(path: Path, mode: int) -> InputError:
    kind = next((kind for holds, kind in _KINDS if holds(mode)), "something else")
    return InputError(f"this is {kind}: an ordinary file is needed", file=path)


def _unreadable(path: Path, error: OSError, what: str) -> InputError:
    """A folder cannot be opened on Windows, and a socket nowhere: the system's own words do not say so."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        mode = 0
    if mode and not stat.S_ISREG(mode):
        return _no_file(path, mode)
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
