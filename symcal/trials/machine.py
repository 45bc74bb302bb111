"""On what numbers were made: the processor, the kernels that ran, and the program. Only alike they are the same bits."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

from symcal.kernels.compile import _processor
from symcal.kernels.compiler import find_compiler

VARIABLE, PORTABLE = "SYMCAL_KERNELS", "vm"
"""What asks for the one level of kernels that every machine has."""

_LIBRARIES = ("casadi", "numpy", "scipy")


@dataclass(frozen=True, slots=True)
class Machine:
    """cpu: its name and a hash of what it can do. kernels: which code ran. program: version, and a hash of its source.
    libraries: versions of what computes.
    """

    cpu: str
    kernels: str
    program: str
    libraries: str

    def facts(self) -> Mapping[str, str]:
        return asdict(self)

    def differs(self, other: Machine, *, portable: bool) -> list[str]:
        """In what another machine is not alike; where kernels are portable the processor does not count."""
        own, their = asdict(self), asdict(other)
        keys = [key for key in own if key != "cpu" or not portable]
        return [f"{key}: {own[key]} and {their[key]}" for key in keys if own[key] != their[key]]


def this_machine(portable: bool = False) -> Machine:
    """What trials in this process are computed with."""
    return Machine(_cpu(), _kernels(portable), f"symcal {version('symcal')} ({_source()})", _libraries())


def _kernels(portable: bool) -> str:
    import os

    chosen = PORTABLE if portable else os.environ.get(VARIABLE, "auto")
    compiler = None if chosen == PORTABLE else find_compiler()
    if compiler is None:
        return "CasADi's virtual machine"
    return f"compiled for this processor by {compiler.version.splitlines()[0]}"


@cache
def _cpu() -> str:
    text = _processor()
    names = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    name = names[0] if names else platform.processor() or platform.machine()
    return f"{name} ({hashlib.sha256(text.encode()).hexdigest()[:8]})"


_SHOW = ("cli", "export", "images", "paper", "plots", "report", "runs", "vision", "compensation")
_SHOW += ("trials/export", "trials/figures", "trials/folder", "trials/need", "trials/report", "trials/results")
_SHOW += ("trials/statistics",)
"""Rooms and files that show numbers, or make none of a trial's."""


@cache
def _source() -> str:
    """A hash of the program's own files, as far as a trial's numbers may depend on them."""
    root = Path(__file__).resolve().parent.parent
    found = hashlib.sha256()
    for path in sorted(p for p in root.rglob("*") if p.suffix in (".py", ".h", ".c")):
        name = path.relative_to(root).with_suffix("").as_posix()
        if name.startswith(_SHOW):
            continue
        found.update(name.encode() + b"\0")
        found.update(path.read_bytes())
    return found.hexdigest()[:12]


@cache
def _libraries() -> str:
    return ", ".join(f"{name} {version(name)}" for name in _LIBRARIES)
