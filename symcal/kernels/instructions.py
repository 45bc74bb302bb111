"""A CasADi function as a short list of typed instructions, and those instructions as C.

Two emitters share it: the batched kernels of this folder and the C export for controllers. Both write the same text,
`a + b` or `real_sin(a)`; what `real` and `real_sin` are is decided by the definitions put in front
(`scalar_definitions` here).

Arrays are row-major on this side, as in numpy and C; CasADi's column-major order ends here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import casadi as ca

from symcal.errors import RefusedError


@dataclass(frozen=True, slots=True)
class Port:
    """A dense input or output array of a function."""

    name: str
    rows: int
    cols: int

    @property
    def size(self) -> int:
        return self.rows * self.cols


@dataclass(frozen=True, slots=True)
class Load:
    """work = inputs[port][element]; the element counts row-major."""

    work: int
    port: int
    element: int


@dataclass(frozen=True, slots=True)
class Store:
    """outputs[port][element] = work; the element counts row-major."""

    work: int
    port: int
    element: int


@dataclass(frozen=True, slots=True)
class Constant:
    """work = value."""

    work: int
    value: float


@dataclass(frozen=True, slots=True)
class Operation:
    """work = op(args); args are work indices, one of which may be the result's own."""

    work: int
    op: str
    args: tuple[int, ...]


Instruction = Load | Store | Constant | Operation


@dataclass(frozen=True, slots=True)
class Program:
    """A straight-line function. Work indices are CasADi's, reused when a value is dead: `work` stays small."""

    name: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    instructions: tuple[Instruction, ...]
    work: int


# The C text of each operation. `p` is the prefix of the definitions in force: `real_` for numbers, `v_` for vectors.
_TEXT = {
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "mul": "{0} * {1}",
    "div": "{0} / {1}",
    "neg": "-{0}",
    "sq": "{0} * {0}",
    "twice": "{0} + {0}",
    "inv": "{p}c(1.0) / {0}",
    "assign": "{0}",
    "lift": "{0}",
}
_TRIGONOMETRY = ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh")
_LIBM = (*_TRIGONOMETRY, "sqrt", "exp", "expm1", "log", "log1p", "floor", "ceil", "fabs", "erf")
_LIBM2 = ("atan2", "pow", "fmin", "fmax", "fmod", "copysign", "hypot")
# Truth values are the numbers 0 and 1, and anything but 0 (NaN too) is true, as in CasADi.
_LOGIC = {
    "lt": "(a, b) ((a) < (b) ? real_c(1.0) : real_c(0.0))",
    "le": "(a, b) ((a) <= (b) ? real_c(1.0) : real_c(0.0))",
    "eq": "(a, b) ((a) == (b) ? real_c(1.0) : real_c(0.0))",
    "ne": "(a, b) ((a) != (b) ? real_c(1.0) : real_c(0.0))",
    "not": "(a) ((a) == real_c(0.0) ? real_c(1.0) : real_c(0.0))",
    "and": "(a, b) ((a) != real_c(0.0) && (b) != real_c(0.0) ? real_c(1.0) : real_c(0.0))",
    "or": "(a, b) ((a) != real_c(0.0) || (b) != real_c(0.0) ? real_c(1.0) : real_c(0.0))",
    "if_else_zero": "(a, b) ((a) != real_c(0.0) ? (b) : real_c(0.0))",
    "sign": "(a) ((a) < real_c(0.0) ? real_c(-1.0) : ((a) > real_c(0.0) ? real_c(1.0) : (a)))",
}
_OPS: dict[int, str] = {
    getattr(ca, f"OP_{name.upper()}"): name
    for name in (*_TEXT, *_LIBM, *_LIBM2, *_LOGIC)
    if hasattr(ca, f"OP_{name.upper()}")
} | {ca.OP_CONSTPOW: "pow"}


def dense_function(function: ca.Function) -> ca.Function:
    """The same function over SX with dense inputs and outputs.

    Entries outside an input's sparsity pattern are not read.

    Args:
        function: any CasADi function that can be expanded to SX.
    Raises:
        RefusedError: the function cannot be expanded (because of a linear solver of CasADi's MX, for example).
    """
    try:
        expanded = function.expand()
        inputs = [ca.SX.sym(name, *function.size_in(i)) for i, name in enumerate(function.name_in())]
        patterned = [ca.project(value, function.sparsity_in(i)) for i, value in enumerate(inputs)]
        outputs = [ca.densify(value) for value in expanded.call(patterned, True, False)]
    except RuntimeError as error:
        raise RefusedError(
            f"function '{function.name()}' cannot be expanded to scalar operations; does it call a linear solver?"
        ) from error
    return ca.Function(function.name(), inputs, outputs, function.name_in(), function.name_out())


def read_program(function: ca.Function) -> Program:
    """The instructions of a CasADi function, after `dense_function`.

    Raises:
        RefusedError: the function cannot be expanded to SX, or has an operation that has no C text here.
    """
    f = dense_function(function)
    inputs = tuple(Port(name, *f.size_in(i)) for i, name in enumerate(f.name_in()))
    outputs = tuple(Port(name, *f.size_out(i)) for i, name in enumerate(f.name_out()))

    def row_major(port: Port, k: int) -> int:
        col, row = divmod(k, port.rows)
        return row * port.cols + col

    instructions: list[Instruction] = []
    for index in range(f.n_instructions()):
        code = f.instruction_id(index)
        source, target = f.instruction_input(index), f.instruction_output(index)
        if code == ca.OP_INPUT:
            instructions.append(Load(target[0], source[0], row_major(inputs[source[0]], source[1])))
        elif code == ca.OP_OUTPUT:
            instructions.append(Store(source[0], target[0], row_major(outputs[target[0]], target[1])))
        elif code == ca.OP_CONST:
            instructions.append(Constant(target[0], f.instruction_constant(index)))
        elif code in _OPS:
            instructions.append(Operation(target[0], _OPS[code], tuple(source)))
        else:
            name = next((n for n in dir(ca) if n.startswith("OP_") and getattr(ca, n) == code), f"number {code}")
            raise RefusedError(f"function '{f.name()}' uses CasADi's {name}, which has no plain C form")
    return Program(f.name(), inputs, outputs, tuple(instructions), f.sz_w())


def c_constant(value: float, prefix: str = "real_") -> str:
    """A number as C text that reads back exactly in double, and rounds once in float."""
    if math.isnan(value):
        return f"{prefix}nan"
    if math.isinf(value):
        return f"(-{prefix}inf)" if value < 0 else f"{prefix}inf"
    return f"{prefix}c({value!r})"


def c_expression(op: str, args: Sequence[str], prefix: str = "real_") -> str:
    """The right-hand side of one operation.

    Args:
        op: name of the operation, as in `Operation.op`.
        args: C names (or bracketed expressions without side effects) of the operands.
        prefix: of the definitions in force.
    """
    if op in _TEXT:
        return _TEXT[op].format(*args, p=prefix)
    return f"{prefix}{op}({', '.join(args)})"


def c_statements(program: Program, inputs: Sequence[str], outputs: Sequence[str]) -> list[str]:
    """The body of a C99 function: declarations, then one statement per instruction.

    Args:
        program: what to compute.
        inputs, outputs: C expressions of type `const real *` and `real *`, one per port; arrays are row-major. An
            output must not overlap an input.
    Returns:
        lines without indentation; they need `scalar_definitions(program)` in front of the function.
    """
    works = sorted({i.work for i in program.instructions if not isinstance(i, Store)})
    lines = [f"real {', '.join(f'w{w}' for w in works[k : k + 16])};" for k in range(0, len(works), 16)]
    used = {i.port for i in program.instructions if isinstance(i, Load)}
    lines += [f"(void){name};" for port, name in enumerate(inputs) if port not in used]
    for i in program.instructions:
        match i:
            case Load(work, port, element):
                lines.append(f"w{work} = {inputs[port]}[{element}];")
            case Store(work, port, element):
                lines.append(f"{outputs[port]}[{element}] = w{work};")
            case Constant(work, value):
                lines.append(f"w{work} = {c_constant(value)};")
            case Operation(work, op, args):
                lines.append(f"w{work} = {c_expression(op, [f'w{a}' for a in args])};")
    return lines


def scalar_definitions(programs: Iterable[Program]) -> str:
    """C99 text that makes `c_statements` compile: `real`, its constants, and the functions that the programs use.

    `real` is double, or float where SYMCAL_FLOAT is defined: then no double is left, not in constants nor libm calls.
    """
    instructions = [i for program in programs for i in program.instructions]
    used = {i.op for i in instructions if isinstance(i, Operation)}
    calls = [(name, "(a)", "(a)") for name in _LIBM if name in used]
    calls += [(name, "(a, b)", "((a), (b))") for name in _LIBM2 if name in used]
    lines = ["#include <math.h>", "#ifdef SYMCAL_FLOAT", "typedef float real;", "#define real_c(x) x##f"]
    lines += [f"#define real_{name}{params} {name}f{args}" for name, params, args in calls]
    lines += ["#else", "typedef double real;", "#define real_c(x) x"]
    lines += [f"#define real_{name}{params} {name}{args}" for name, params, args in calls]
    lines += ["#endif"]
    if any(isinstance(i, Constant) and not math.isfinite(i.value) for i in instructions):
        lines += ["#define real_inf ((real)INFINITY)", "#define real_nan ((real)NAN)"]
    lines += [f"#define real_{name}{text}" for name, text in _LOGIC.items() if name in used]
    return "\n".join(lines) + "\n"
