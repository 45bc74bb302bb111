"""On what numbers were made: the kernels that ran, on which processor, and the program. Only alike they are the same
bits."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

from symcal.kernels import path_in_use
from symcal.kernels.path import Choice


def kernels_of(portable: bool) -> Choice:
    """What runs the kernels of a study: the one level that every machine has, or what is best here."""
    return "portable" if portable else "auto"


@dataclass(frozen=True, slots=True)
class Machine:
    """processor: its name. kernels: which code ran. bits: what decides on their bits, see `KernelPath.bits`.
    program: version, and a hash of its source.
    """

    processor: str
    kernels: str
    bits: str
    program: str

    def facts(self) -> Mapping[str, str]:
        return asdict(self)

    def differs(self, other: Machine) -> list[str]:
        """In what another machine is not alike, as far as it decides on bits."""
        pairs = {"kernels": (self.bits, other.bits), "program": (self.program, other.program)}
        return [f"{name}: {own} and {their}" for name, (own, their) in pairs.items() if own != their]


def this_machine(portable: bool = False) -> Machine:
    """What trials in this process are computed with."""
    path = path_in_use(kernels_of(portable))
    program = f"symcal {version('symcal')} ({_source()}), scipy {version('scipy')}"
    # fits are done by our own code in C and by LAPACK without
    bits = f"{path.bits}, fits by {'C' if path.backend == 'c' else 'numpy'}"
    return Machine(path.processor, str(path), bits, program)


_SHOW = (
    *("cli", "compensation", "doctor", "export", "images", "paper", "plots", "report", "runs", "vision"),
    *(f"trials/{name}" for name in ("export", "figures", "folder", "identity", "need")),
    *(f"trials/{name}" for name in ("report", "results", "statistics")),
)
"""Rooms and files that show numbers, or make none of a trial's."""
_BUILDS = "runs/load"  # what is identified, in a room that otherwise shows


@cache
def _source() -> str:
    """A hash of the program's own files, as far as a trial's numbers may depend on them."""
    root = Path(__file__).resolve().parent.parent
    found = hashlib.sha256()
    for path in sorted(p for p in root.rglob("*") if p.suffix in (".py", ".h", ".c")):
        name = path.relative_to(root).with_suffix("").as_posix()
        if name.startswith(_SHOW) and name != _BUILDS:
            continue
        found.update(name.encode() + b"\0")
        found.update(path.read_bytes())
    return found.hexdigest()[:12]
