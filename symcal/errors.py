"""Everything that symcal refuses, as one family of exceptions.

The command line turns any `SymcalError` into one message and exit code 1: a traceback always means a bug of ours.
Children carry their facts as attributes, so that a program can react without parsing the message.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path


class SymcalError(Exception):
    """Root of all errors that the user can mend.

    Example:
        >>> import symcal as sc
        >>> try:
        ...     sc.load_robot("nowhere.yaml")
        ... except sc.SymcalError as error:
        ...     print(type(error).__name__)
        InputError
    """


class InputError(SymcalError):
    """A file says something that cannot be used.

    Attributes:
        message: what is wrong and what to do.
        file, line, part, key, column: where; each may be None when it does not apply. Lines, and rows of a sheet, count
            from 1; a part is a sheet or a topic.
        found: the offending value as text. allowed: the values that would do.

    Example:
        >>> import symcal as sc
        >>> try:
        ...     sc.parse_board("chessboard:9x6:25")
        ... except sc.InputError as error:
        ...     print(error.found)
        25
    """

    def __init__(
        self,
        message: str,
        *,
        file: Path | str | None = None,
        line: int | None = None,
        part: str | None = None,
        key: str | None = None,
        column: str | None = None,
        found: object = None,
        allowed: Iterable[str] = (),
    ) -> None:
        self.message = message
        self.file = None if file is None else Path(file)
        self.line = line
        self.part = part
        self.key = key
        self.column = column
        self.found = None if found is None else str(found)
        self.allowed = tuple(allowed)
        super().__init__(message)

    def __str__(self) -> str:
        where = "" if self.file is None else str(self.file)
        if self.line is not None:
            where += f":{self.line}" if where else f"line {self.line}"
        key = f"key '{_short(self.key)}'" if self.key else ""
        column = f"column '{_short(self.column)}'" if self.column else ""
        message = self.message if len(self.message) <= _LONGEST else self.message[:_LONGEST] + "..."
        part = _short(self.part) if self.part else ""
        text = ": ".join(each for each in (where, part, key, column, message) if each)
        if self.found is not None:
            text += f" (found: {_short(self.found)})"
        if self.allowed:
            asked = _short(self.found or (self.key or "").rpartition(".")[2])
            close = get_close_matches(asked, map(_short, self.allowed[:_COMPARED]), n=1)
            hint = f"did you mean '{close[0]}'? " if close else ""
            more = len(self.allowed) - _LISTED
            tail = f", and {more} more" if more > 0 else ""
            text += f"; {hint}allowed: {', '.join(map(_short, self.allowed[:_LISTED]))}{tail}"
        return printable(text)


_LISTED, _COMPARED = 100, 1000  # of the allowed values: those shown, and those that a typing error may have meant


def _short(text: str) -> str:
    """In one line, and no longer than a name may be."""
    text = " ".join(text[:_CUT].split())
    return text if len(text) <= 80 else text[:77] + "..."


_CUT, _LONGEST = 1000, 2000  # characters: of a name that is looked at, of a message (which may quote some)


def printable(text: str) -> str:
    """Text with every character escaped that a terminal would obey, or could not show.

    Names in files may hold the control sequences that clear a screen or rewrite a line.
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c == "\n" else c.encode("unicode_escape", "surrogatepass").decode() for c in text
    )


class RefusedError(SymcalError):
    """The input is readable, but what is asked cannot be done honestly with it; the message says why and what helps.

    Example:
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> try:
        ...     sc.wanted(robot, [[[1, 0, 0, 300], [0, 1, 0, 300], [0, 0, 1, 900], [0, 0, 0, 1]]])
        ... except sc.RefusedError as error:
        ...     print(str(error)[:27])
        handling-robot has 5 joints
    """
