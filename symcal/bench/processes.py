"""A command in a process of its own: time of the clock and of the processor, and the most memory it held."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Ended:
    """wall, cpu: s, children included. peak: most memory held, MB. said: the end of what went to standard error.

    cpu and peak are None where the system does not tell them of a child.
    """

    status: int
    wall: float
    cpu: float | None
    peak: float | None
    said: str


def run_process(
    command: Sequence[str], environment: Mapping[str, str] | None = None, folder: Path | None = None
) -> Ended:
    """Run to its end, with nothing to read and its output dropped.

    Args:
        environment: variables that differ from this process's. folder: where it runs.
    """
    began = time.perf_counter()
    process = subprocess.Popen(
        list(command),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={**os.environ, **(environment or {})},
        cwd=folder,
    )
    assert process.stderr is not None
    with process.stderr as pipe:
        said = pipe.read()[-2000:].decode(errors="replace").strip()
    if sys.platform == "win32":
        return Ended(process.wait(), time.perf_counter() - began, None, None, said)
    _, status, used = os.wait4(process.pid, 0)
    wall = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)  # it is reaped: Popen must not wait for it again
    unit = 1e6 if sys.platform == "darwin" else 1e3  # bytes there, kilobytes elsewhere
    return Ended(process.returncode, wall, used.ru_utime + used.ru_stime, used.ru_maxrss / unit, said)


def symcal_command(*arguments: str) -> list[str]:
    """This installation's command line."""
    return [sys.executable, "-m", "symcal.cli", *arguments]
