"""Evaluate a CasADi function at many points at once: compiled C, straight-line numpy, or CasADi's virtual machine.

All do the same arithmetic and agree to rounding (about 1e-13 relative), not bit for bit. Which one runs is decided
when a `BatchFunction` is made, from the arguments, what is asked for (SYMCAL_KERNELS) and the presence of a compiler
alone (see `symcal.kernels.path`); never from the state of a cache or in the middle of a job. So the same job gives the
same bits on the same machine, from its first run on. And a row's result depends on that row alone, not on N or its
neighbours.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError, RefusedError
from symcal.kernels.compiled import Compiled, compiled
from symcal.kernels.instructions import Port, Program, dense_function, read_program
from symcal.kernels.path import Choice, Kind, chosen_kind
from symcal.kernels.straight_line import straight_line
from symcal.kernels.virtual_machine import interpreted

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]
# (number of rows, dense C-contiguous inputs, outputs to fill)
_Run = Callable[[int, list[Array], list[Array]], None]

# More instructions than this keep a compiler busy for many seconds.
_TOO_LONG = 20_000
_FLOAT = np.dtype(np.float64)
_KEPT = 256  # plans; one has some hundred bytes


@dataclass(frozen=True, slots=True)
class _Plan:
    """What follows from the shapes of arguments: the number of rows, whether there are any, the shapes of results."""

    rows: int
    many: bool
    shapes: tuple[tuple[int, ...], ...]
    run: _Run


@dataclass(frozen=True, slots=True)
class PreparedCall:
    """A call that is made again and again with the same arrays; made by `BatchFunction.prepared`.

    Attributes:
        arguments: what each call reads. Write into them to change it.
        results: what each call fills and returns.
    """

    arguments: tuple[Array, ...]
    results: tuple[Array, ...]
    _run: Callable[[], None] = field(repr=False)

    def __call__(self) -> tuple[Array, ...]:
        self._run()
        return self.results


@dataclass(frozen=True)
class BatchFunction:
    """A function of dense vectors and matrices, evaluated for N rows in one call; made by `batch_function`.

    Attributes:
        function: what is computed, with dense inputs and outputs.
        program: its instructions; None if the virtual machine runs them.
        kind: what runs it.
    """

    function: ca.Function
    program: Program | None
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    kind: Kind
    # What was prepared for a pattern of shared and batched arguments, and for shapes; a row's result is the same with
    # and without.
    _runs: dict[tuple[bool, ...], _Run] = field(default_factory=dict, compare=False, repr=False)
    _plans: dict[tuple[tuple[int, ...], ...], _Plan] = field(default_factory=dict, compare=False, repr=False)

    @property
    def backend(self) -> str:
        """`c`, `numpy` or `vm`. Should a compiler then fail, the log says so and what needs none runs after all."""
        return self.kind.backend

    def __call__(self, *args: Array, out: Sequence[Array] | None = None) -> tuple[Array, ...]:
        """Evaluate for N rows.

        Args:
            args: one per input, float64. A vector input of n rows takes shape (n,), shared by all N, or (N, n); a
                matrix input (rows, cols) or (N, rows, cols). They need not be contiguous.
            out: arrays to fill, one per output, float64, C-contiguous and of the shapes below; they must not share
                memory with an argument. It spares large results the cost of fresh memory.
        Returns:
            per output, C-contiguous: (N, n) for a vector, (N, rows, cols) for a matrix; without N if no argument has
            it. Freshly allocated, or those of `out`.
        Raises:
            InputError: wrong number or shape of arguments, unequal N, or arrays in `out` that cannot be filled.
        """
        arrays = [np.ascontiguousarray(arg, _FLOAT) for arg in args]
        plan = self._plans.get(tuple([array.shape for array in arrays])) or self._planned(arrays)
        results = [np.empty(shape) for shape in plan.shapes] if out is None else self._given(plan, arrays, out)
        if plan.rows:
            plan.run(plan.rows, arrays, results)
        return tuple(results) if plan.many else tuple([result[0] for result in results])

    def prepared(self, *args: Array, out: Sequence[Array] | None = None) -> PreparedCall:
        """A call of these arrays that can be repeated without its checks: what small batches mostly cost.

        Args:
            args, out: as in a call. Arguments that are float64 and C-contiguous are read where they are at every call
                (`PreparedCall.arguments`), others were copied. Without `out`, new arrays are filled.
        Raises:
            InputError: as in a call.
        """
        arrays = [np.ascontiguousarray(arg, _FLOAT) for arg in args]
        plan = self._plans.get(tuple([array.shape for array in arrays])) or self._planned(arrays)
        given = [np.empty(shape if plan.many else shape[1:]) for shape in plan.shapes] if out is None else list(out)
        results = self._given(plan, arrays, given)
        if not plan.rows:
            run: Callable[[], None] = _nothing
        elif isinstance(plan.run, Compiled):
            run = plan.run.bind(plan.rows, arrays, results)
        else:
            run = partial(plan.run, plan.rows, arrays, results)
        return PreparedCall(tuple(arrays), tuple(given), run)

    def __reduce__(self) -> tuple[object, ...]:
        """To another process goes the function; code is loaded there again, from the cache."""
        return BatchFunction, (self.function, self.program, self.inputs, self.outputs, self.kind)

    def _planned(self, arrays: list[Array]) -> _Plan:
        if len(arrays) != len(self.inputs):
            raise InputError(f"'{self.function.name()}' takes {len(self.inputs)} arguments, not {len(arrays)}")
        batched = tuple(_is_batched(array, port) for array, port in zip(arrays, self.inputs, strict=True))
        lengths = {array.shape[0] for array, many in zip(arrays, batched, strict=True) if many}
        if len(lengths) > 1:
            shapes = {port.name: array.shape for port, array in zip(self.inputs, arrays, strict=True)}
            raise InputError(f"arguments of '{self.function.name()}' have different numbers of rows", found=shapes)
        rows = lengths.pop() if lengths else 1
        if rows and batched not in self._runs:
            self._runs[batched] = self._prepare(batched)
        run = self._runs[batched] if rows else _fill_nothing
        if len(self._plans) >= _KEPT:
            self._plans.clear()
        plan = _Plan(rows, any(batched), tuple((rows, *_shape(port)) for port in self.outputs), run)
        self._plans[tuple(array.shape for array in arrays)] = plan
        return plan

    def _prepare(self, batched: tuple[bool, ...]) -> _Run:
        portable = self.kind.portable
        if self.program is not None and any(batched) and self.kind.backend == "c":
            found = compiled(self.program, batched, portable=portable)
            if found is not None:
                return found
        if self.program is None or not (any(batched) or portable):  # a single evaluation is not worth writing it out
            return interpreted(self.function, self.inputs, self.outputs, batched)
        return straight_line(self.program, batched, portable=portable)

    def _given(self, plan: _Plan, arrays: list[Array], out: Sequence[Array]) -> list[Array]:
        """Arrays to fill, with a batch axis."""
        wanted = [shape if plan.many else shape[1:] for shape in plan.shapes]
        found = [getattr(array, "shape", None) for array in out]
        if found != wanted:
            message = f"'{self.function.name()}' cannot fill arrays of these shapes"
            raise InputError(message, key="out", found=found, allowed=map(str, wanted))
        for array in out:
            if array.dtype != _FLOAT or not array.flags.carray:
                raise InputError("arrays to be filled must be float64, C-contiguous and writeable", key="out")
            # Two arrays that are no views share memory only if they are one; asking costs more than a small batch.
            views = arrays if array.base is not None else [a for a in arrays if a.base is not None or a is array]
            if any(np.may_share_memory(array, argument) for argument in views):
                raise InputError("an array to be filled shares memory with an argument", key="out")
        return [array if plan.many else array[None] for array in out]


def batch_function(function: ca.Function, *, backend: Choice = "auto", evaluations: int | None = None) -> BatchFunction:
    """A CasADi function as a `BatchFunction`.

    Args:
        function: any function that can be expanded to SX; sparse inputs and outputs become dense.
        backend: see `symcal.kernels.path.chosen_kind`. What cannot be written as a program runs in CasADi's virtual
            machine, and the log says so.
        evaluations: how many rows will be evaluated in all, if known. Give a number that follows from the job alone, so
            that its results repeat.
    Raises:
        InputError: SYMCAL_KERNELS is something else. RefusedError: the function cannot be expanded to SX.
    """
    kind = chosen_kind(backend, evaluations)
    dense = dense_function(function)
    program = _readable(dense) if kind.backend != "vm" else None
    inputs = tuple(Port(name, *dense.size_in(i)) for i, name in enumerate(dense.name_in()))
    outputs = tuple(Port(name, *dense.size_out(i)) for i, name in enumerate(dense.name_out()))
    return BatchFunction(dense, program, inputs, outputs, kind if program is not None else Kind("vm"))


def _readable(dense: ca.Function) -> Program | None:
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


def _fill_nothing(n: int, arrays: list[Array], results: list[Array]) -> None:
    """For no rows."""


def _nothing() -> None:
    """For no rows."""
