"""Independent pieces of work shared between this process and a copy of it, where the system lets one make a copy."""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import NoReturn, TypeVar

Result = TypeVar("Result")

_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of Linux
_MOST = 256  # pieces: their numbers are handed out as bytes


def side_by_side(work: Sequence[Callable[[], Result]]) -> list[Result]:
    """The results of pieces of work in their order, done by this process and a forked copy: whoever is free takes the
    next. They may write files; what they change in memory may be lost.

    A copy needs no second start-up and no pickling of what the work needs, only of results. One after the other where
    there is one core, or no fork that is safe (Windows; macOS, whose libraries do not allow it). What the copy could
    not do is done again here, so that an error is raised as without it.
    """
    if not 1 < len(work) <= _MOST or not may_fork():
        return [piece() for piece in work]
    turns, ahead = os.pipe()
    os.write(ahead, bytes(range(len(work))))
    os.close(ahead)
    answer, answering = os.pipe()
    parent = os.getpid()
    with warnings.catch_warnings():
        # Python 3.12 warns of other threads (the terminal's spinner, BLAS): the copy touches neither their locks nor
        # what they were doing
        warnings.simplefilter("ignore", DeprecationWarning)
        copy = os.fork()
    if copy == 0:
        _answer(work, turns, answering, parent)
    os.close(answering)
    whole = False
    try:
        done = {i: work[i]() for i in _taken(turns)}
        with os.fdopen(answer, "rb", closefd=False) as stream:
            done |= _read(stream.read())
        whole = True
    finally:
        if not whole:
            os.kill(copy, signal.SIGKILL)
        os.waitpid(copy, 0)
        os.close(turns)
        os.close(answer)
    return [done[i] if i in done else piece() for i, piece in enumerate(work)]


def may_fork() -> bool:
    """Whether a copy of this process would have a core of its own, and may be made."""
    return sys.platform == "linux" and cores() > 1


def cores() -> int:
    """Processors that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not everywhere
        return os.cpu_count() or 1


def _taken(turns: int) -> Iterator[int]:
    """Numbers of pieces that nobody has taken, until there are none: reading a byte from a pipe is atomic."""
    while number := os.read(turns, 1):
        yield number[0]


def _answer(work: Sequence[Callable[[], Result]], turns: int, answering: int, parent: int) -> NoReturn:
    """The copy's share; it ends here whatever happens, without what Python does at its end."""
    done: dict[int, Result] = {}
    try:
        try:
            ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)  # with its locks, so that what it left is mended
            if os.getppid() == parent:
                for i in _taken(turns):
                    done[i] = work[i]()
        finally:
            with os.fdopen(answering, "wb") as stream:
                stream.write(pickle.dumps(done))
    finally:
        os._exit(0)


def _read(answer: bytes) -> dict[int, Result]:
    """What the copy did; nothing where it was killed."""
    try:
        done: dict[int, Result] = pickle.loads(answer)
    except (EOFError, pickle.UnpicklingError):
        return {}
    return done
