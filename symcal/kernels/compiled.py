"""A program as compiled C, called through ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.kernels.compile import load_library
from symcal.kernels.instructions import Program
from symcal.kernels.vector import ENTRY, kernel_source

Array = NDArray[np.float64]

_LONG = 3000
"""Instructions: more would keep GCC busy for over a second at -O2; -O1 needs half of it, its code 15 % more."""


@dataclass(frozen=True, slots=True)
class Compiled:
    """A C function of n and the addresses of all inputs and outputs."""

    entry: Callable[..., None]

    def __call__(self, n: int, arrays: list[Array], results: list[Array]) -> None:
        self.entry(n, *[address(array) for array in (*arrays, *results)])

    def bind(self, n: int, arrays: list[Array], results: list[Array]) -> Callable[[], None]:
        """The same call again and again; whoever holds it must keep the arrays."""
        return partial(self.entry, n, *[address(array) for array in (*arrays, *results)])


def compiled(program: Program, batched: tuple[bool, ...], *, portable: bool) -> Compiled | None:
    """The kernel for a pattern of shared and batched arguments; None where there is no compiler or it fails."""
    source = kernel_source(program, batched, portable=portable)
    entry = entry_of(source, ENTRY, len(program.instructions), portable=portable)
    if entry is None:
        return None
    entry.argtypes = [ctypes.c_ssize_t] + [ctypes.c_void_p] * (len(program.inputs) + len(program.outputs))
    entry.restype = None
    return Compiled(entry)


def entry_of(source: str, name: str, instructions: int, *, portable: bool) -> Any:
    """The function of this name in a compiled source, of which types are still to be said; None where there is no
    compiler or it fails.

    Args:
        instructions: of the program that the source is made of, by which the level of optimisation is chosen.
        portable: see `symcal.kernels.compile.load_library`.
    """
    library = load_library(source, "-O2" if instructions < _LONG else "-O1", name, portable=portable)
    return None if library is None else getattr(library, name)


def address(array: NDArray[Any]) -> int:
    """Where the elements of a contiguous array are; whoever uses it must keep the array."""
    try:  # three times faster than the other way, which counts in small batches
        return ctypes.addressof(_buffer(array))
    except (TypeError, ValueError):  # it is read-only
        return int(array.__array_interface__["data"][0])


_buffer: Any = (ctypes.c_char * 0).from_buffer
