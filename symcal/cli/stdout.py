"""Standard output that may be full, or read by nobody any more."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOBase
from typing import TextIO, cast

from symcal.errors import SymcalError


class StdoutError(SymcalError):
    """What was to be printed could not be; what was written to files is there."""


class ReaderGone(SystemExit):
    """Who read standard output has closed it (`| head -1`): there is nobody to tell, and nothing more to say."""


class NamedStdout(TextIOBase):
    """A text stream whose failures are `StdoutError`, or `ReaderGone` where the reader has closed its end."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._stream.encoding

    def fileno(self) -> int:
        return self._stream.fileno()

    def isatty(self) -> bool:
        return self._stream.isatty()

    def writable(self) -> bool:
        return True

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)
        except OSError as error:
            raise self._failure(error) from None

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError as error:
            raise self._failure(error) from None

    def _failure(self, error: OSError) -> BaseException:
        if error.errno == errno.EPIPE:
            silence(self._stream)
            return ReaderGone(1)
        return StdoutError(f"standard output cannot be written: {error.strerror}; what went to files is there")


def silence(stream: TextIO) -> None:
    """Let the rest of what is printed, and what the interpreter still flushes at its end, go nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


@contextmanager
def named_stdout() -> Iterator[None]:
    """Give failures of standard output a name, to its last flush; nothing is done where it is not the system's.

    Raises:
        StdoutError: it cannot be written. ReaderGone: nobody reads it.
    """
    system: TextIO | None = sys.stdout
    redirected = system is not sys.__stdout__
    if system is None or redirected:
        yield
        return
    named = NamedStdout(system)
    sys.stdout = cast("TextIO", named)
    try:
        try:
            yield
        finally:
            named.flush()
    except StdoutError:
        silence(system)
        raise
    finally:
        sys.stdout = system
