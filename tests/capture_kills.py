"""A capture and its instrument killed at random moments: nothing that was read is lost, and nothing stands twice.

    python tests/capture_kills.py [kills]           50 by default, of either side in turn

Both sides run in children that have loaded everything. A kill falls some events after the last one and up to 50 ms
later, so into reading, checking and writing alike; the other side goes on, and the killed one is started again. What
stands in the journal after a kill must stand there ever after, and at the end the table must be that of a capture that
nobody disturbed, byte by byte.
"""

# ruff: noqa: T201

from __future__ import annotations

import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from difflib import unified_diff
from pathlib import Path

import numpy as np
from capture_draws import TOLERANCE, quick_plan
from interrupted import forked

from symcal.capture.aim import Aim, aim_of
from symcal.capture.journal import JOURNAL
from symcal.capture.run import capture
from symcal.capture.server import serve
from symcal.capture.session import MEASUREMENTS
from symcal.capture.simulated import Mishaps, simulated

MISHAPS = Mishaps(outliers=0.1, misses=0.1)
_WAIT = 60.0  # seconds in which something must happen


@dataclass
class Sides:
    """A capture into a folder, in the plan's order, and the server that it asks."""

    plan: Path
    aim: Aim
    out: Path
    port: int = 0
    running: dict[str, int] = field(default_factory=dict)

    def start(self, side: str) -> None:
        self.running[side] = forked(self._serving if side == "server" else self._capturing)

    def _serving(self) -> None:
        there = simulated(self.aim, 5, MISHAPS)
        serve(self.aim, there, self.port, lambda _: None)

    def _capturing(self) -> None:
        address = f"tcp://127.0.0.1:{self.port}"
        capture(self.plan, self.out, instrument=address, tolerance=TOLERANCE, order="plan")

    def kill(self, side: str) -> None:
        pid = self.running.pop(side)
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)

    def ended(self) -> bool:
        """Whether the capture came to its end."""
        pid, status = os.waitpid(self.running["capture"], os.WNOHANG)
        assert status == 0, "the capture failed"
        return pid != 0

    def lines(self) -> list[bytes]:
        """What the journal holds, whole lines alone."""
        path = self.out / JOURNAL
        return path.read_bytes().split(b"\n")[:-1] if path.exists() else []


def free_port() -> int:
    import socket

    with socket.create_server(("127.0.0.1", 0)) as there:
        return int(there.getsockname()[1])


def until(done: Callable[[], bool]) -> None:
    last = time.monotonic() + _WAIT
    while not done():
        assert time.monotonic() < last, "nothing happens any more"
        time.sleep(0.002)


def undisturbed(plan: Path, aim: Aim, folder: Path) -> bytes:
    """The table of a capture that nobody disturbed."""
    sides = Sides(plan, aim, folder, free_port())
    sides.start("server")
    sides.start("capture")
    until(sides.ended)
    sides.kill("server")
    return (folder / MEASUREMENTS).read_bytes()


def disturbed(plan: Path, aim: Aim, folder: Path, kills: int, rng: np.random.Generator) -> tuple[bytes, int]:
    """The table after so many kills, and how many of them there were before the end."""
    sides = Sides(plan, aim, folder, free_port())
    sides.start("server")
    sides.start("capture")
    count, known = 0, list[bytes]()
    while count < kills:
        wanted = len(sides.lines()) + int(rng.integers(0, 4))
        over = [False]

        def moved_on(wanted: int = wanted, over: list[bool] = over) -> bool:
            over[0] = sides.ended()
            return over[0] or len(sides.lines()) >= wanted

        until(moved_on)
        if over[0]:
            break
        time.sleep(float(rng.uniform(0, 0.05)))
        if sides.ended():
            break
        side = ("capture", "server")[count % 2]
        sides.kill(side)
        count += 1
        now = sides.lines()
        assert now[: len(known)] == known, "what was written has changed"
        known = now
        sides.start(side)
    else:
        until(sides.ended)
    sides.kill("server")
    return (folder / MEASUREMENTS).read_bytes(), count


def main(kills: int) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        plan = quick_plan(Path(scratch))
        aim = aim_of(plan, TOLERANCE)
        whole, count, rng, rounds = undisturbed(plan, aim, Path(scratch) / "whole"), 0, np.random.default_rng(1), 0
        while count < kills:
            out = Path(scratch) / "killed"
            shutil.rmtree(out, ignore_errors=True)
            table, more = disturbed(plan, aim, out, kills - count, rng)
            assert table == whole, "\n".join(unified_diff(*(text.decode().splitlines() for text in (whole, table))))
            count, rounds = count + more, rounds + 1
        print(f"{count} kills in {rounds} captures of {whole.count(b'P,')} readings: every table is that without kills")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
