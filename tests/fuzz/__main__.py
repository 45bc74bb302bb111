"""`python -m tests.fuzz N [READER ...]`: N mutated inputs for each reader; `--start K` for others than the first ones.

`python -m tests.fuzz --replay READER SEED [FILE]` reads one again, and keeps it in a file. Findings are printed with
their seed; the exit code is 1 if there are any.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from .readers import READERS, ROOT
from .worker import WAITING, input_of, outcomes

_SILENT_S = WAITING + 30.0  # nothing said for so long: hangs where no signal reaches it
_START_S = 120.0


def watched(reader: str, start: int, stop: int) -> list[tuple[int, str, str]]:
    """Outcomes (seed, kind, text) of a worker that is killed, and counts as a finding, when it says nothing."""
    read, write = os.pipe()
    command = f"from tests.fuzz.worker import serve; serve({reader!r}, {start}, {stop}, {write})"
    with tempfile.TemporaryFile() as noise:
        process = subprocess.Popen(
            [sys.executable, "-c", command], cwd=ROOT, pass_fds=[write], stdout=noise, stderr=noise
        )
        os.close(write)
        done: list[tuple[int, str, str]] = []
        with os.fdopen(read, "rb") as pipe:
            buffer, patience = b"", _START_S
            while True:
                ready, _, _ = select.select([pipe], [], [], patience)
                piece = os.read(pipe.fileno(), 65536) if ready else b""
                if not piece:
                    break
                patience = _SILENT_S
                *lines, buffer = (buffer + piece).split(b"\n")
                done += [tuple(json.loads(line)) for line in lines]
        process.kill()
        process.wait()
        if len(done) < stop - start:
            noise.seek(0)
            done.append(
                (start + len(done), "finding", f"killed or hung: {noise.read()[-2000:].decode(errors='replace')}")
            )
    return done


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=100)
    parser.add_argument("readers", nargs="*", choices=[[], *READERS])
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--replay", nargs="+", metavar=("READER", "SEED"))
    asked = parser.parse_args()
    if asked.replay:
        return _replay(*asked.replay)
    found = 0
    for reader in asked.readers or READERS:
        began, counts, at, stop = time.monotonic(), Counter[str](), asked.start, asked.start + asked.count
        while at < stop:
            for at, kind, said in watched(reader, at, stop):  # noqa: B020 - goes on behind one that ended the worker
                counts[kind] += 1
                if kind == "finding":
                    _say(f"--- {reader} {at}\n{said}")
            at += 1
        found += counts["finding"]
        _say(
            f"{reader}: {counts.total()} inputs, {counts['ok']} read, {counts['refused']} refused, "
            f"{counts['finding']} findings, {time.monotonic() - began:.0f} s"
        )
    return 1 if found else 0


def _replay(reader: str, seed: str, file: str | None = None) -> int:
    with tempfile.TemporaryDirectory() as folder:
        content = input_of(reader, int(seed), READERS[reader].seeds(Path(folder)))
    if file is not None:
        Path(file).write_bytes(content)
    (outcome,) = outcomes(reader, range(int(seed), int(seed) + 1))
    _say(f"{content[:2000]!r}\n{outcome.kind}: {outcome.said}")
    return 1 if outcome.kind == "finding" else 0


if __name__ == "__main__":
    sys.exit(main())
