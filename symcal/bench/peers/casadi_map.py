"""CasADi by itself: `Function.map` through `Function.buffer`, interpreted or as the C that it generates.

The expression is the package's own, which is smaller than what automatic differentiation gives: CasADi's best case.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.kernels.compiler import CompilerError, compile_c, find_compiler

Array = NDArray[np.float64]

FLAGS = ("-O3", "-march=native", "-shared", "-fPIC")


@contextmanager
def compiled(function: ca.Function) -> Iterator[ca.Function | None]:
    """The function as generated C, compiled with `FLAGS`; None without a compiler that works."""
    compiler = find_compiler()
    if compiler is None:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="symcal-bench-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        generator = ca.CodeGenerator("function.c")
        generator.add(function)
        generator.generate(f"{folder}/")
        library = folder / "function.so"
        try:
            compile_c(compiler, [*FLAGS, str(folder / "function.c"), "-o", str(library), "-lm"])
        except CompilerError:
            yield None
            return
        yield ca.external(function.name(), str(library))


def mapped(function: ca.Function, batched: tuple[Array, ...], shared: tuple[Array, ...]) -> Callable[[], list[Array]]:
    """A call of the map of N over all rows, into results allocated beforehand.

    Args:
        function: of vectors, to vectors and matrices. batched: its first arguments, shape (N, k); they may be written
            to between calls. shared: the others, (k,), repeated N times here, which is faster than letting CasADi.
    Returns:
        what fills and gives one array for each output: (N, rows), or (N, cols, rows) for a matrix, which CasADi stores
        by columns.
    """
    count = len(batched[0])
    given = [*batched, *(np.tile(each, (count, 1)) for each in shared)]
    results = [
        np.empty((count, *((cols, rows) if cols != 1 else (rows,))))
        for rows, cols in map(function.size_out, range(function.n_out()))
    ]
    many = function.map(count, "serial")
    buffer: Any
    buffer, evaluate = many.buffer()
    for i, each in enumerate(given):
        buffer.set_arg(i, each.data)
    for i, each in enumerate(results):
        buffer.set_res(i, each.data)

    def run() -> list[Array]:
        evaluate()
        return results

    run.kept = (many, buffer, given)  # type: ignore[attr-defined]  # what the buffer points to lives as long as the call
    return run
