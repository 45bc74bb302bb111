"""Which code runs: C for this processor, portable C, numpy, or CasADi's virtual machine; and what it is called."""

from __future__ import annotations

import hashlib
import logging
import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from typing import Literal

import numpy as np

from symcal.errors import InputError
from symcal.kernels.compile import NATIVE, processor
from symcal.kernels.compiler import VERSION_TIMEOUT_S, Compiler, CompilerError, find_compiler, output_of

logger = logging.getLogger(__name__)

VARIABLE = "SYMCAL_KERNELS"
Choice = Literal["auto", "c", "numpy", "vm", "portable"]
CHOICES: tuple[Choice, ...] = ("auto", "c", "numpy", "vm", "portable")

_asked: ContextVar[Choice] = ContextVar("asked", default="auto")

# Evaluations below which something simpler is over sooner. All costs grow with the number of instructions, so both
# hardly depend on the function. Below the first numpy takes some tenths of a second at most, less than most first
# compilations; below the second the virtual machine takes some 20 ms, as long as writing numpy's text and reading it.
WORTH_COMPILING = 50_000
WORTH_WRITING = 2_000

SLOWER = 15
"""How many times slower than C numpy is, about: position and Jacobian of the handling robot, 1000 rows. Measured by
`python tests/kernels/speed.py c,numpy`, which compares all paths in one process and can be run again."""


@dataclass(frozen=True, slots=True)
class Kind:
    """What runs a function. portable: the level whose bits are the same everywhere, see `path_in_use`."""

    backend: Literal["c", "numpy", "vm"]
    portable: bool = False


@dataclass(frozen=True, slots=True)
class KernelPath:
    """On what the numbers of a job with many evaluations are made.

    backend: `c`, `numpy` or `vm`. portable: whether this is the portable level. compiler: what it calls itself, empty
    without. instructions: what the processor is asked for. processor: its name, and a hash of what it can do.
    libraries: versions of what computes.
    """

    backend: str
    portable: bool
    compiler: str
    instructions: str
    processor: str
    libraries: str

    def __str__(self) -> str:
        if self.portable:
            return f"portable, {'C by ' + self.compiler if self.backend == 'c' else 'numpy'}"
        if self.backend == "c":
            return f"C by {self.compiler} ({self.instructions})"
        return "numpy" if self.backend == "numpy" else "CasADi's virtual machine"

    def facts(self) -> Mapping[str, str | bool]:
        """Everything, by name."""
        return asdict(self)

    @property
    def bits(self) -> str:
        """What must be equal on two machines for their kernels to give the same bits; at the portable level only the
        libraries, whoever compiled and whichever processor ran."""
        if self.portable:
            return f"portable on {platform.machine()}, {self.libraries}"
        used = str(self) if self.backend == "c" else f"{self} ({self.instructions})"
        return f"{used}, {self.processor}, {self.libraries}"


@contextmanager
def kernels_by(choice: Choice) -> Iterator[None]:
    """Meanwhile `auto` means this choice in this thread, whatever the environment says; with `auto` nothing changes."""
    before = _asked.set(choice if choice != "auto" else _asked.get())
    try:
        yield
    finally:
        _asked.reset(before)


def choice_in_force() -> Choice:
    """What `auto` means now: what `kernels_by` asks for, else what the environment's SYMCAL_KERNELS says.

    Raises:
        InputError: SYMCAL_KERNELS is something else.
    """
    asked = _asked.get()
    name = asked if asked != "auto" else os.environ.get(VARIABLE, "auto")
    for choice in CHOICES:
        if choice == name:
            return choice
    raise InputError("unknown backend for kernels", key=VARIABLE, found=name, allowed=CHOICES)


def chosen_kind(choice: Choice, evaluations: int | None) -> Kind:
    """What runs a function; it follows from the arguments, `choice_in_force` and the presence of a compiler alone.

    Args:
        choice: `auto`: see `choice_in_force`, else by the number of evaluations: `vm` for a few, `numpy` for some
            thousand, `c` for more.
            `c`: compiled for this processor; `numpy` where there is no compiler.
            `numpy`: straight-line numpy. `vm`: CasADi's virtual machine.
            `portable`: see `path_in_use`.
        evaluations: how many rows will be evaluated in all; None: many.
    Raises:
        InputError: no such choice.
    """
    name = choice if choice != "auto" else choice_in_force()
    portable, many = name == "portable", evaluations is None or evaluations >= WORTH_COMPILING
    if name == "vm" or (name == "auto" and evaluations is not None and evaluations < WORTH_WRITING):
        return Kind("vm")
    if name == "numpy" or (name != "c" and not many):
        return Kind("numpy", portable)
    kind = Kind("c" if find_compiler() is not None else "numpy", portable)
    if logger.isEnabledFor(logging.INFO):
        _say_once(_sentence(_described(kind), asked=name != "auto"))
    return kind


def path_in_use(choice: Choice = "auto") -> KernelPath:
    """What a job with many evaluations runs on, in this process as it is now; short ones may run on less.

    At the portable level (SYMCAL_KERNELS=portable) every operation is rounded on its own, nothing is used that only
    some processors of a kind have, and sines and cosines are our own, in C and in numpy alike: so kernels give the
    same bits on every x86-64 machine, with any compiler or none. What is not covered: functions that are left to the C
    library or to numpy (arcs, exponentials, logarithms, powers, sines beyond 1e5 rad), functions that have no program
    and run in the virtual machine, constants that CasADi computed while a model was built, and linear algebra behind
    the kernels, which LAPACK does as its processor is best at (OPENBLAS_CORETYPE fixes that).

    Args:
        choice: as in `chosen_kind`.
    Raises:
        InputError: SYMCAL_KERNELS is something else.
    """
    return _described(chosen_kind(choice, None))


def _described(kind: Kind) -> KernelPath:
    compiler = find_compiler() if kind.backend == "c" else None
    return KernelPath(
        kind.backend,
        kind.portable,
        "" if compiler is None else compiler.name,
        _instructions(compiler, kind),
        _processor_name(),
        _libraries(),
    )


def _sentence(path: KernelPath, *, asked: bool) -> str:
    if path.backend == "c":
        return f"kernels: {path}"
    if asked and not path.portable and find_compiler() is not None:
        return f"kernels: {path}, about {SLOWER} times slower than C"
    return (
        f"kernels: {path}, no C compiler: about {SLOWER} times slower than with one (install one, or "
        "'pip install symcal[fast]')"
    )


@cache
def _say_once(text: str) -> None:
    logger.info(text)


@cache
def _instructions(compiler: Compiler | None, kind: Kind) -> str:
    """What is used of a processor: as the compiler says, or numpy."""
    if kind.portable:
        return "nothing beyond the oldest of its kind"
    if compiler is None:
        found = np.show_config(mode="dicts")["SIMD Extensions"].get("found", []) if kind.backend == "numpy" else []
        return ", ".join(found)
    try:
        said = output_of(compiler, [*NATIVE, "-dM", "-E", "-x", "c", os.devnull], VERSION_TIMEOUT_S)
    except CompilerError as error:
        logger.info("%s", error)
        return "unknown instructions"
    macros = {line.split()[1] for line in said.splitlines() if line.startswith("#define ")}
    known = [name for name in ("AVX512F", "AVX2", "FMA", "SSE2", "ARM_NEON") if {f"__{name}", f"__{name}__"} & macros]
    return f"{8 if 'AVX512F' in known else 4} lanes" + "".join(f", {name}" for name in known)


@cache
def _processor_name() -> str:
    names = [line.partition(":")[2].strip() for line in processor().splitlines() if line.startswith("model name")]
    name = names[0] if names else platform.processor() or platform.machine()
    return f"{name} ({hashlib.sha256(processor().encode()).hexdigest()[:8]})"


@cache
def _libraries() -> str:
    named = [f"{name} {version(name)}" for name in ("casadi", "numpy")]
    return ", ".join([*named, " ".join(platform.libc_ver()).strip() or platform.platform()])
