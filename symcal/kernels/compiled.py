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

# More instructions than this would keep GCC busy for over a second at -O2; -O1 needs half of it, its code 15 % more.
_LONG = 3000


@dataclass(frozen=True, slots=True)
class Compiled:
    """A C function of n and the addresses of all inputs and outputs."""

    entry: Callable[..., None]

    def __call__(self, n: int, arrays: list[Array], results: list[Array]) -> None:
        self.entry(n, *map(_address, arrays), *map(_address, results))

    def bind(self, n: int, arrays: list[Array], results: list[Array]) -> Callable[[], None]:
        """The same call again and again; whoever holds it must keep the arrays."""
        return partial(self.entry, n, *map(_address, arrays), *map(_address, results))


def compiled(program: Program, batched: tuple[bool, ...], *, portable: bool) -> Compiled | None:
    """The kernel for a pattern of shared and batched arguments; None where there is no compiler or it fails."""
    optimisation = "-O2" if len(program.instructions) < _LONG else "-O1"
    source = kernel_source(program, batched, portable=portable)
    library = load_library(source, optimisation, ENTRY, portable=portable)
    if library is None:
        return None
    entry: Any = getattr(library, ENTRY)
    entry.argtypes = [ctypes.c_ssize_t] + [ctypes.c_void_p] * (len(program.inputs) + len(program.outputs))
    entry.restype = None
    return Compiled(entry)


_char_at = ctypes.c_char.from_buffer
_address_of = ctypes.addressof


def _address(array: Array) -> int:
    try:  # three times faster than the other way, which counts in small batches
        return _address_of(_char_at(array))  # type: ignore[arg-type]
    except (TypeError, ValueError):  # read-only or empty
        return int(array.__array_interface__["data"][0])
