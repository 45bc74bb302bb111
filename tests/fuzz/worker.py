"""Reads mutated inputs in this process, each within its time and memory, and tells what came of them."""

from __future__ import annotations

import os
import signal
import tempfile
import traceback
import warnings
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .finished import fine
from .mutations import mutated
from .readers import READERS

SECONDS, WAITING = 5.0, 30.0
"""Of computing, and of waiting: a machine may be busy with other things."""
MEMORY = 2**30


class TooLong(BaseException):
    """Not an Exception: nothing that is read may swallow it."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Of the input with a seed: `ok`, `refused` or `finding`, and what was said."""

    reader: str
    seed: int
    kind: str
    said: str = ""


def input_of(reader: str, seed: int, seeds: list[bytes]) -> bytes:
    """The mutated input of a seed: always the same."""
    return mutated(np.random.default_rng([zlib.crc32(reader.encode()), seed]), seeds)


def limit_memory() -> None:
    """From here on this process may take a GB more than it has."""
    import resource  # not everywhere

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def outcomes(reader: str, numbers: range) -> Iterator[Outcome]:
    """Read the inputs of some seeds; warnings count as errors."""
    from symcal.errors import SymcalError

    def late(*_: object) -> None:
        raise TooLong

    one = READERS[reader]
    before = {number: signal.signal(number, late) for number in (signal.SIGALRM, signal.SIGPROF)}
    try:
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("error")
            path = Path(folder) / f"input{one.suffix}"
            seeds = one.seeds(Path(folder))
            for number in numbers:
                path.write_bytes(input_of(reader, number, seeds))
                signal.setitimer(signal.ITIMER_PROF, SECONDS)
                signal.setitimer(signal.ITIMER_REAL, WAITING)
                try:
                    one.read(path)
                    outcome = Outcome(reader, number, "ok")
                except SymcalError as error:
                    text = str(error)
                    told = ("refused", text) if fine(text) else ("finding", repr(text))
                    outcome = Outcome(reader, number, *told)
                except TooLong:
                    outcome = Outcome(reader, number, "finding", "too long\n" + traceback.format_exc())
                except BaseException:  # noqa: BLE001 - that is what is looked for
                    outcome = Outcome(reader, number, "finding", traceback.format_exc())
                finally:
                    signal.setitimer(signal.ITIMER_PROF, 0)
                    signal.setitimer(signal.ITIMER_REAL, 0)
                yield outcome
    finally:
        for clock, handler in before.items():
            signal.signal(clock, handler)


def serve(reader: str, start: int, stop: int, pipe: int) -> None:
    """Of a process of its own: a line per input, findings with their text, into a pipe."""
    import json

    READERS[reader].seeds(Path(tempfile.mkdtemp()))  # libraries are loaded before memory is counted
    limit_memory()
    with os.fdopen(pipe, "w") as out:
        for outcome in outcomes(reader, range(start, stop)):
            said = outcome.said if outcome.kind == "finding" else ""
            out.write(json.dumps([outcome.seed, outcome.kind, said]) + "\n")
            out.flush()
