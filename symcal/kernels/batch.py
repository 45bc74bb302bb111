"""Evaluate a CasADi function at many points at once: compiled C, or CasADi's virtual machine without a compiler.

Both backends do the same arithmetic and agree to rounding (about 1e-13 relative), not bit for bit. Which one runs is
decided when a `BatchFunction` is made, from the arguments, SYMCAL_KERNELS and the presence of a compiler alone; never
from the state of a cache or in the middle of a job. So the same job gives the same bits on the same machine, from its
first run on. And a row's result depends on that row alone, not on N or on its neighbours.
"""

from __future__ import annotations

import ctypes
import logging
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError, RefusedError
from symcal.kernels.compile import load_library
from symcal.kernels.compiler import find_compiler
from symcal.kernels.instructions import Port, Program, dense_function, read_program
from symcal.kernels.vector import ENTRY, kernel_source

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]
Backend = Literal["auto", "vm", "c"]
# (number of rows, dense C-contiguous inputs, outputs to fill)
_Run = Callable[[int, list[Array], list[Array]], None]

# Fewer evaluations than this take the virtual machine some tenths of a second at most, less than most first
# compilations. Both costs grow with the number of instructions: the break-even hardly depends on the function.
WORTH_COMPILING = 50_000
# More instructions than this would keep GCC busy for over a second at -O2; -O1 needs half of it, its code 15 % more.
_LONG = 3000
# And more than this for many seconds.
_TOO_LONG = 20_000


@dataclass(frozen=True)
class BatchFunction:
    """A function of dense vectors and matrices, evaluated for N rows in one call; made by `batch_function`.

    Attributes:
        function: what is computed, with dense inputs and outputs.
        program: its instructions; None if the virtual machine runs them.
    """

    function: ca.Function
    program: Program | None
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    # What was prepared for a pattern of shared and batched arguments; filled on first use, never changed after.
    _runs: dict[tuple[bool, ...], _Run] = field(default_factory=dict, compare=False, repr=False)

    @property
    def backend(self) -> Literal["vm", "c"]:
        """`c` if calls are to run compiled; should the compiler then fail, the log says so and `vm` runs after all."""
        return "vm" if self.program is None else "c"

    def __call__(self, *args: Array) -> tuple[Array, ...]:
        """Evaluate for N rows.

        Args:
            args: one per input, float64. A vector input of n rows takes shape (n,), shared by all N, or (N, n); a
                matrix input (rows, cols) or (N, rows, cols). They need not be contiguous.
        Returns:
            per output, freshly allocated and C-contiguous: (N, n) for a vector, (N, rows, cols) for a matrix; without N
            if no argument has it.
        Raises:
            InputError: wrong number or shape of arguments, or unequal N.
        """
        if len(args) != len(self.inputs):
            raise InputError(f"'{self.function.name()}' takes {len(self.inputs)} arguments, not {len(args)}")
        arrays = [np.ascontiguousarray(arg, dtype=np.float64) for arg in args]
        batched = tuple(_is_batched(array, port) for array, port in zip(arrays, self.inputs, strict=True))
        lengths = {array.shape[0] for array, many in zip(arrays, batched, strict=True) if many}
        if len(lengths) > 1:
            shapes = {port.name: array.shape for port, array in zip(self.inputs, arrays, strict=True)}
            raise InputError(f"arguments of '{self.function.name()}' have different numbers of rows", found=shapes)
        n = lengths.pop() if lengths else 1
        results = [np.empty((n, *_shape(port))) for port in self.outputs]
        if n > 0:
            if batched not in self._runs:
                self._runs[batched] = self._prepare(batched)
            self._runs[batched](n, arrays, results)
        return tuple(results) if any(batched) else tuple(result[0] for result in results)

    def __reduce__(self) -> tuple[object, ...]:
        """To another process goes the function; code is loaded there again, from the cache."""
        return BatchFunction, (self.function, self.program, self.inputs, self.outputs)

    def _prepare(self, batched: tuple[bool, ...]) -> _Run:
        compiled = None
        if self.program is not None and any(batched):  # a single evaluation is not worth a compiler
            compiled = _compiled(self.program, batched)
        return compiled or _interpreted(self.function, self.inputs, self.outputs, batched)


def batch_function(
    function: ca.Function, *, backend: Backend = "auto", evaluations: int | None = None
) -> BatchFunction:
    """A CasADi function as a `BatchFunction`.

    Args:
        function: any function that can be expanded to SX; sparse inputs and outputs become dense.
        backend: `vm`, `c`, or `auto`: the environment's SYMCAL_KERNELS if set, else `c` if this machine has a compiler
            and the job is long enough for it. Where C is not possible the virtual machine runs, and the log says so.
        evaluations: how many rows will be evaluated in all, if known; less than `WORTH_COMPILING` makes `auto` stay
            with the virtual machine. Give a number that follows from the job alone, so that its results repeat.
    Raises:
        InputError: SYMCAL_KERNELS is something else. RefusedError: the function cannot be expanded to SX.
    """
    chosen = backend if backend != "auto" else os.environ.get("SYMCAL_KERNELS", "auto")
    allowed = ("auto", "vm", "c")
    if chosen not in allowed:
        raise InputError("unknown backend for kernels", key="SYMCAL_KERNELS", found=chosen, allowed=allowed)
    if chosen == "auto":
        chosen = "c" if evaluations is None or evaluations >= WORTH_COMPILING else "vm"
    dense = dense_function(function)
    program = None
    if chosen == "c" and find_compiler() is None:
        logger.info("no C compiler: '%s' runs in CasADi's virtual machine", function.name())
    elif chosen == "c":
        program = _worth_compiling(dense)
    inputs = tuple(Port(name, *dense.size_in(i)) for i, name in enumerate(dense.name_in()))
    outputs = tuple(Port(name, *dense.size_out(i)) for i, name in enumerate(dense.name_out()))
    return BatchFunction(dense, program, inputs, outputs)


def _worth_compiling(dense: ca.Function) -> Program | None:
    try:
        program = read_program(dense)
    except RefusedError as error:
        logger.info("%s; it runs in CasADi's virtual machine", error)
        return None
    if len(program.instructions) > _TOO_LONG:
        logger.info("'%s' is too long to compile and runs in CasADi's virtual machine", program.name)
        return None
    return program


def _shape(port: Port) -> tuple[int, ...]:
    return (port.rows,) if port.cols == 1 else (port.rows, port.cols)


def _is_batched(array: Array, port: Port) -> bool:
    shape = _shape(port)
    if array.shape == shape:
        return False
    if array.shape[1:] == shape and array.ndim == len(shape) + 1:
        return True
    many = ", ".join(["N", *map(str, shape)])
    raise InputError(
        f"argument '{port.name}' has shape {array.shape}; wanted {shape} (shared) or ({many})", key=port.name
    )


def _compiled(program: Program, batched: tuple[bool, ...]) -> _Run | None:
    optimisation = "-O2" if len(program.instructions) < _LONG else "-O1"
    library = load_library(kernel_source(program, batched), optimisation, ENTRY)
    if library is None:
        return None
    entry = getattr(library, ENTRY)
    entry.argtypes = [ctypes.c_ssize_t] + [ctypes.c_void_p] * (len(program.inputs) + len(program.outputs))
    entry.restype = None

    def run(n: int, arrays: list[Array], results: list[Array]) -> None:
        entry(n, *[_address(array) for array in (*arrays, *results)])

    return run


def _address(array: Array) -> int:
    if array.size and array.flags.writeable:  # five times faster than the other way, which counts in small batches
        return ctypes.addressof(ctypes.c_char.from_buffer(array.data))
    return int(array.__array_interface__["data"][0])


def _interpreted(
    function: ca.Function, inputs: tuple[Port, ...], outputs: tuple[Port, ...], batched: tuple[bool, ...]
) -> _Run:
    """The virtual machine, by maps of fixed sizes: making a map for each N would cost more than running it."""
    shared = [i for i, many in enumerate(batched) if not many]
    maps = [(size, function.map(f"rows{size}", "serial", size, shared, [])) for size in (256, 16, 1)]

    def run(n: int, arrays: list[Array], results: list[Array]) -> None:
        # CasADi is column-major: rows of transposed matrices.
        given = [
            np.ascontiguousarray(a.swapaxes(-1, -2)) if p.cols != 1 else a for a, p in zip(arrays, inputs, strict=True)
        ]
        filled = [
            np.empty((n, port.cols, port.rows)) if port.cols != 1 else r
            for r, port in zip(results, outputs, strict=True)
        ]
        start = 0
        for size, mapped in maps:
            if n - start < size:
                continue
            buffer: Any
            buffer, evaluate = mapped.buffer()
            for i in shared:
                buffer.set_arg(i, given[i].data)
            while n - start >= size:
                for i, many in enumerate(batched):
                    if many:
                        buffer.set_arg(i, given[i][start : start + size].data)
                for i, whole in enumerate(filled):
                    buffer.set_res(i, whole[start : start + size].data)
                evaluate()
                start += size
        for result, whole in zip(results, filled, strict=True):
            if whole is not result:
                result[...] = whole.swapaxes(-1, -2)

    return run
