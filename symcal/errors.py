"""Everything that symcal refuses, as one family of exceptions.

The command line turns any `SymcalError` into one message and exit code 1: a traceback always means a bug of ours.
Children carry their facts as attributes, so that a program can react without parsing the message.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path


class SymcalError(Exception):
    """Root of all errors that the user can mend."""


class InputError(SymcalError):
    """A file says something that cannot be used.

    Attributes:
        message: what is wrong and what to do.
        file, line, key, column: where; each may be None when it does not apply. Lines count from 1.
        found: the offending value as text. allowed: the values that would do.
    """

    def __init__(
        self,
        message: str,
        *,
        file: Path | str | None = None,
        line: int | None = None,
        key: str | None = None,
        column: str | None = None,
        found: object = None,
        allowed: Iterable[str] = (),
    ) -> None:
        self.message = message
        self.file = None if file is None else Path(file)
        self.line = line
        self.key = key
        self.column = column
        self.found = None if found is None else str(found)
        self.allowed = tuple(allowed)
        super().__init__(message)

    def __str__(self) -> str:
        where = "" if self.file is None else str(self.file)
        if self.line is not None:
            where += f":{self.line}" if where else f"line {self.line}"
        key = f"key '{self.key}'" if self.key else ""
        column = f"column '{self.column}'" if self.column else ""
        text = ": ".join(part for part in (where, key, column, self.message) if part)
        if self.found is not None:
            found = " ".join(self.found.split())
            text += f" (found: {found if len(found) <= 80 else found[:77] + '...'})"
        if self.allowed:
            close = get_close_matches(self.found or (self.key or "").rpartition(".")[2], self.allowed, n=1)
            hint = f"did you mean '{close[0]}'? " if close else ""
            text += f"; {hint}allowed: {', '.join(self.allowed)}"
        return text


class RefusedError(SymcalError):
    """The input is readable, but what is asked cannot be done honestly with it; the message says why and what helps."""
