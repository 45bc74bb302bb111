"""The line of a file that an error is about, with a mark under the key: as compilers show it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from unicodedata import combining, east_asian_width

from symcal.documents.document import LINE_END
from symcal.documents.read import DOCUMENT_LIMIT, read_text
from symcal.errors import InputError, printable

_MARGIN = 8  # columns before the text
_DOTS = "..."  # for what is left out of a long line


@dataclass(frozen=True, slots=True)
class Excerpt:
    """A line of a file, or the part of it around the mark.

    number: counts from 1. text: printable. start, length: of the mark, in columns of a terminal.
    """

    number: int
    text: str
    start: int
    length: int

    def lines(self) -> tuple[str, str]:
        """The line with its number, and the mark under it."""
        margin = f"{self.number:{_MARGIN - 3}}"
        return f"{margin} | {self.text}", f"{' ' * len(margin)} | {' ' * self.start}{'^' * self.length}"


def excerpt(error: InputError, width: int) -> Excerpt | None:
    """The line that an error about a YAML file names; None where it names none, or the file is gone.

    Args:
        width: columns of the terminal; of a line that does not fit, the part around the mark is shown.
    """
    if error.file is None or error.line is None or error.column is not None:
        return None
    if error.file.suffix.lower() not in (".yaml", ".yml"):
        return None
    try:
        lines = LINE_END.split(read_text(error.file, DOCUMENT_LIMIT))
    except InputError:
        return None
    if not 1 <= error.line <= len(lines):
        return None
    line = lines[error.line - 1].rstrip()
    return _cut(error.line, line, _marked(line, error), max(20, width - _MARGIN)) if line else None


def _cut(number: int, line: str, mark: tuple[int, int], room: int) -> Excerpt:
    start, end = mark
    long = len(line) > room
    room -= 2 * len(_DOTS) * long
    first = max(0, min(start - room // 2, len(line) - room)) if long else 0
    last = min(len(line), first + room)
    before, after = _DOTS * (first > 0), _DOTS * (last < len(line))
    end = min(end, last)
    head, marked, tail = (_shown(part) for part in (line[first:start], line[start:end], line[end:last]))
    return Excerpt(number, f"{before}{head}{marked}{tail}{after}", len(before) + _width(head), _width(marked))


def _shown(text: str) -> str:
    return printable(text.replace("\t", " "))


def _marked(line: str, error: InputError) -> tuple[int, int]:
    """Where the mark stands: under the key, else under the value that was found, else under all that is written."""
    names = [error.key.rpartition(".")[2]] if error.key else []
    names += [re.sub(r"(\[\d+\])+$", "", name) for name in names]
    for name in filter(None, names):
        key = re.search(rf"(?<![\w.-])(['\"]?){re.escape(name)}\1(?=\s*:)", line)
        if key is not None:
            return key.span()
    if error.found:
        value = re.search(rf"(?<!\w){re.escape(error.found)}(?!\w)", line)
        if value is not None:
            return value.span()
    written = re.match(r"\s*(?:-\s+)*(.*?)\s*(?:\s#.*)?$", line, re.S)
    return written.span(1) if written is not None and written.group(1) else (0, len(line))


def _width(text: str) -> int:
    """Columns that a text takes in a terminal."""
    return sum(0 if combining(c) else 2 if east_asian_width(c) in "WF" else 1 for c in text)
