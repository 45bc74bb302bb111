"""CasADi's own interpreter on many rows: for functions that have no plain form, and for a few evaluations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symcal.kernels.instructions import Port

Array = NDArray[np.float64]
Run = Callable[[int, list[Array], list[Array]], None]


def interpreted(
    function: ca.Function, inputs: tuple[Port, ...], outputs: tuple[Port, ...], batched: tuple[bool, ...]
) -> Run:
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
