"""A program as straight-line numpy: the path without a compiler.

One ufunc call per instruction, over blocks of rows held as one array per value. What depends on shared inputs alone is
computed once, on arrays of one element. The text that is run is made here, of names that are counted here and ours:
nothing of a file is in it.

A row's result depends on that row alone: sums, products, quotients and roots are those of IEEE 754 wherever an element
stands, and what numpy computes in vectors of its own (sines, exponentials) is always given whole, aligned ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.kernels.compiled import address
from symcal.kernels.instructions import Constant, Load, Operation, Program, Store
from symcal.kernels.numpy_operations import EXACT, ROUNDED, sincos

Array = NDArray[np.float64]
Run = Callable[[int, list[Array], list[Array]], None]

BLOCK = 4096  # rows at once: enough to hide what a call costs; a value takes 32 kB
_WHOLE = 16  # elements: two of the longest vectors there are
_SAME = ("assign", "lift")
_REWRITTEN = {"sq": "mul", "twice": "add", "inv": "div"}


def straight_line(program: Program, batched: tuple[bool, ...], *, portable: bool) -> Run:
    """A function (n, inputs, outputs to fill) of C-contiguous arrays, batch first.

    Args:
        program: what to compute.
        batched: per input, whether it has n rows (True) or is shared by all rows.
        portable: sines and cosines by our own arithmetic, as in the C kernel of that level, instead of numpy's.
    """
    text = _written(program, batched, portable)
    scope: dict[str, Any] = {f"op_{name}": ufunc for name, ufunc in (EXACT | ROUNDED).items()} | {"sincos": sincos}
    scope |= {name: np.array([value]) for name, value in text.constants.items()}
    exec(compile(text.source(), "<straight line>", "exec"), scope)
    once, block = scope["once"], scope["block"]
    sizes = [port.size for port, many in zip(program.inputs, batched, strict=True) if many]
    spare: list[tuple[list[Array], Array]] = []  # buffers, one set for each thread inside: pop and append are atomic

    def run(n: int, arrays: list[Array], results: list[Array]) -> None:
        rows_of = [array.reshape(n, -1) for array, many in zip(arrays, batched, strict=True) if many and array.size]
        given = [array.reshape(-1) for array, many in zip(arrays, batched, strict=True) if not many]
        filled = [result.reshape(n, -1) for result in results if result.size]
        try:
            buffers, work = spare.pop()
        except IndexError:
            buffers, work = [_aligned(size) for size in sizes if size], _aligned(text.registers)
        try:
            with np.errstate(all="ignore"):
                shared = once(*given)
                for start in range(0, n, BLOCK):
                    stop = min(start + BLOCK, n)
                    for buffer, rows in zip(buffers, rows_of, strict=True):
                        buffer[:, : stop - start] = rows[start:stop].T
                    whole = -(-(stop - start) // _WHOLE) * _WHOLE
                    block(stop - start, whole, shared, buffers, work, [each[start:stop].T for each in filled])
        finally:
            spare.append((buffers, work))

    return run


def _aligned(rows: int) -> Array:
    """Zeros, shape (rows, BLOCK), every row at the start of a cache line."""
    memory = np.zeros(rows * BLOCK + 8)
    start = -address(memory) % 64 // 8
    return memory[start : start + rows * BLOCK].reshape(rows, BLOCK)


@dataclass(slots=True)
class _Text:
    """Lines of the two functions; grows only inside `_written`.

    Names: c* constants, s* shared values, i*e* rows of inputs, w* registers, o*e* columns of outputs, v* our own sines.
    With p behind, an array reaches to the end of its last whole vector.
    """

    program: Program
    batched: tuple[bool, ...]
    once: list[str] = field(default_factory=list)
    block: list[str] = field(default_factory=list)
    constants: dict[str, float] = field(default_factory=lambda: {"one": 1.0})
    shared: list[str] = field(default_factory=list)
    free: list[str] = field(default_factory=list)
    registers: int = 0
    padded: set[str] = field(default_factory=set)

    def register(self) -> str:
        if self.free:
            return self.free.pop()
        self.registers += 1
        return f"w{self.registers - 1}"

    def share(self, name: str, value: str) -> str:
        """Compute something once."""
        self.once.append(f"{name} = {value}")
        self.shared.append(name)
        return name

    def sines(self, k: int, angle: str) -> str:
        """Compute sine and cosine of a value; their names are what is returned with sin or cos behind."""
        if angle[0] in "cs":
            self.once.append(f"s{k}sin, s{k}cos = sincos({angle})")
            self.shared += [f"s{k}sin", f"s{k}cos"]
            return f"s{k}"
        self.block.append(f"v{k}sin, v{k}cos = sincos({angle})")
        return f"v{k}"

    def whole(self, name: str) -> str:
        """The name of an array up to the end of its last whole vector."""
        if name[0] not in "iw":
            return name
        self.padded.add(name)
        return f"{name}p"

    def source(self) -> str:
        given = [f"a{k}" for k, many in enumerate(self.batched) if not many]
        kept = "".join(f"{name}, " for name in self.shared)
        ins = [(k, p.size) for k, p in enumerate(self.program.inputs) if self.batched[k] and p.size]
        outs = [(k, p.size) for k, p in enumerate(self.program.outputs) if p.size]
        arrays = [("w", "work", range(self.registers))]
        arrays += [(f"i{k}e", f"inputs[{place}]", range(size)) for place, (k, size) in enumerate(ins)]
        head = [f"{kept} = shared"] if kept else []
        for prefix, array, numbers in arrays:
            head += [f"{''.join(f'{prefix}{j}, ' for j in numbers)} = {array}[:, :rows]"] if numbers else []
            head += [f"{prefix}{j}p = {array}[{j}, :whole]" for j in numbers if f"{prefix}{j}" in self.padded]
        head += [f"{''.join(f'o{k}e{j}, ' for j in range(size))} = outs[{at}]" for at, (k, size) in enumerate(outs)]
        first = [f"def once({', '.join(given)}):", *self.once, f"return ({kept})"]
        second = ["def block(rows, whole, shared, inputs, work, outs):", *head, *self.block, "return"]
        return "\n    ".join(first) + "\n" + "\n    ".join(second) + "\n"


def _written(program: Program, batched: tuple[bool, ...], portable: bool) -> _Text:
    operands = _operands(program)
    last = {a: k for k, args in enumerate(operands) for a in args}
    uses = Counter(a for args in operands for a in args)
    stores = [(i, args[0]) for i, args in zip(program.instructions, operands, strict=True) if isinstance(i, Store)]
    straight_to = {value: f"o{i.port}e{i.element}" for i, value in stores if uses[value] == 1}
    text = _Text(program, batched)
    names: dict[int, str] = {}  # by the instruction that makes the value
    sines: dict[int, str] = {}  # where our own sine and cosine of a value are
    for k, (i, args) in enumerate(zip(program.instructions, operands, strict=True)):
        known = [names[a] for a in args]
        dying = [names[a] for a in dict.fromkeys(args) if last[a] == k and names[a].startswith("w")]
        match i:
            case Constant(_, value):
                names[k] = f"c{k}"
                text.constants[f"c{k}"] = value
            case Load(_, port, element) if batched[port]:
                names[k] = f"i{port}e{element}"
            case Load(_, port, element):
                names[k] = text.share(f"s{k}", f"a{port}[{element}:{element + 1}]")
            case Store(_, port, element):
                if known[0] != f"o{port}e{element}":
                    text.block.append(f"o{port}e{element}[...] = {known[0]}")
            case Operation(_, op, _) if op in _SAME:
                pass  # `_operands` goes to what is assigned
            case Operation(_, op, _) if portable and op in ("sin", "cos"):
                if args[0] not in sines:
                    sines[args[0]] = text.sines(k, known[0])
                names[k] = sines[args[0]] + op
            case Operation(_, op, _) if all(name[0] in "cs" for name in known):
                names[k] = text.share(f"s{k}", _call(op, known))
            case Operation(_, op, _) if op in ROUNDED:
                names[k] = text.register()
                text.block.append(_call(op, [text.whole(name) for name in (*known, names[k])]))
            case Operation(_, op, _):
                text.free += dying
                dying = []
                names[k] = straight_to.get(k) or text.register()
                text.block.append(_call(op, [*known, names[k]]))
        text.free += dying
    return text


def _call(op: str, names: list[str]) -> str:
    """A ufunc call; the last name is the array to fill if there are rows."""
    if op in ("sq", "twice"):
        names = [names[0], *names]
    if op == "inv":
        names = ["one", *names]
    return f"op_{_REWRITTEN.get(op, op)}({', '.join(names)})"


def _operands(program: Program) -> list[tuple[int, ...]]:
    """For every instruction, which instructions made the values that it takes."""
    made: dict[int, int] = {}  # by work index
    operands: list[tuple[int, ...]] = []
    for k, i in enumerate(program.instructions):
        match i:
            case Store(work, _, _):
                operands.append((made[work],))
            case Operation(work, op, args) if op in _SAME:
                operands.append(())
                made[work] = made[args[0]]
            case Operation(work, _, args):
                operands.append(tuple(made[a] for a in args))
                made[work] = k
            case Load(work, _, _) | Constant(work, _):
                operands.append(())
                made[work] = k
    return operands
