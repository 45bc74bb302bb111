"""A command in a process of its own: time of the clock and of the processor, and the most memory it held."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

# A process counts as its own the memory of the one that it was forked from: this one is small.
_LAUNCHER = """
import json, os, subprocess, sys, time
began = time.perf_counter()
with open(sys.argv[1], "wb") as output:
    child = subprocess.Popen(sys.argv[2:], stdin=subprocess.DEVNULL, stdout=output)
_, status, used = os.wait4(child.pid, 0)
wall = time.perf_counter() - began
child.returncode = status  # it is reaped
print(json.dumps([status, wall, used.ru_utime + used.ru_stime, used.ru_maxrss]))
"""


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
    command: Sequence[str],
    environment: Mapping[str, str] | None = None,
    folder: Path | None = None,
    output: Path | None = None,
) -> Ended:
    """Run to its end, with nothing to read.

    Args:
        environment: variables that differ from this process's. folder: where it runs. output: file for what it
            prints; dropped when None.
    """
    own = {**os.environ, **(environment or {})}
    if sys.platform == "win32":
        began = time.perf_counter()
        end = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, env=own, cwd=folder, check=False)
        if output is not None:
            output.write_bytes(end.stdout)
        return Ended(end.returncode, time.perf_counter() - began, None, None, _last(end.stderr))
    launched = subprocess.run(
        [sys.executable, "-I", "-S", "-c", _LAUNCHER, str(output or os.devnull), *command],
        capture_output=True,
        env=own,
        cwd=folder,
        check=True,
    )
    status, wall, cpu, peak = json.loads(launched.stdout)
    unit = 1e6 if sys.platform == "darwin" else 1e3  # bytes there, kilobytes elsewhere
    return Ended(os.waitstatus_to_exitcode(status), wall, cpu, peak / unit, _last(launched.stderr))


def _last(said: bytes) -> str:
    return said[-2000:].decode(errors="replace").strip()


def symcal_command(*arguments: str) -> list[str]:
    """This installation's command line."""
    return [sys.executable, "-m", "symcal.cli", *arguments]
