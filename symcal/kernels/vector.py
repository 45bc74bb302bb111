"""A batched kernel in C: one program for LANES poses at a time, over plain row-major arrays.

What depends on shared inputs alone (most sines and cosines of a robot: those of its parameters) is computed once, in
scalar code, with libm's sines unless the level is the portable one; the rest in vectors. Lanes are filled from, and
written to, rows of the caller's arrays.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import resources

from symcal.kernels.instructions import (
    Constant,
    Load,
    Operation,
    Program,
    Store,
    c_constant,
    c_expression,
    scalar_definitions,
)

ENTRY = "symcal_kernel"


def scalar_text(programs: Iterable[Program], *, portable: bool) -> str:
    """`scalar_definitions` for what is computed outside of the lanes; sines and cosines are always among them.

    Args:
        portable: sines and cosines are our own there too, as in the lanes, not libm's. Comes after lanes.h then.
    """
    own = "scalar_" if portable else ""
    sines = "\n".join(f"#undef real_{name}\n#define real_{name}(a) {own}{name}(a)" for name in ("sin", "cos"))
    return f"{scalar_definitions(programs)}{sines}\n"


def kernel_source(program: Program, batched: tuple[bool, ...], *, portable: bool = False) -> str:
    """C source of `void symcal_kernel(ptrdiff_t n, const double *in..., double *out...)`.

    Args:
        program: what to compute.
        batched: per input, whether it has n rows (True) or is shared by all rows; at least one is batched.
        portable: sines and cosines of shared values are our own too, not libm's.
    Returns:
        source for GCC or Clang. All input pointers, then all output pointers; arrays are row-major, batch first.
    """
    shared_lines, block_lines, shared_count = _bodies(program, batched)
    ins = [f"a{i}" for i in range(len(program.inputs))]
    outs = [f"r{i}" for i in range(len(program.outputs))]
    rows_in = [(f"a{i}", port.size) for i, port in enumerate(program.inputs) if batched[i] and port.size]
    rows_out = [(f"r{i}", port.size) for i, port in enumerate(program.outputs) if port.size]
    signature = [f"const double *{name}" for name in ins] + [f"double *{name}" for name in outs]
    block_signature = [f"const double *restrict {n}" for n in ("shared", *(a for a, _ in rows_in))]
    block_signature += [f"double *restrict {n}" for n, _ in rows_out]
    shared_names = [name for i, name in enumerate(ins) if not batched[i]]
    whole = ", ".join(["shared", *(f"{n} + i * {size}" for n, size in rows_in + rows_out)])
    part = ", ".join(["shared", *(f"{n}_part" for n, _ in rows_in + rows_out)])
    lines = [
        resources.files(__package__).joinpath("lanes.h").read_text(encoding="utf-8"),
        scalar_text([program], portable=portable),
        f"static void shared_values({', '.join([*(f'const double *{n}' for n in shared_names), 'double *shared'])}) {{",
        *(f"  {line}" for line in shared_lines),
        "}",
        # Never inlined: the last, partial block must run the very same instructions as the others.
        f"static __attribute__((noinline)) void block({', '.join(block_signature)}) {{",
        *(f"  {line}" for line in block_lines),
        "}",
        f"void {ENTRY}(ptrdiff_t n, {', '.join(signature)}) {{",
        f"  double shared[{max(shared_count, 1)}];",
        f"  shared_values({', '.join([*shared_names, 'shared'])});",
        "  ptrdiff_t i = 0;",
        "  for (; i + LANES <= n; i += LANES) {",
        *(f"    v_expect({n} + (i + AHEAD * LANES) * {size}, LANES * {size});" for n, size in rows_out),
        f"    block({whole});",
        "  }",
        "  if (i == n) return;",
        *(f"  double {n}_part[LANES * {size}];" for n, size in rows_in + rows_out),
        "  for (ptrdiff_t k = 0; k < LANES; k++) {",
        "    const ptrdiff_t row = i + k < n ? i + k : n - 1;",
        *(f"    memcpy({n}_part + k * {size}, {n} + row * {size}, {size} * sizeof(double));" for n, size in rows_in),
        "  }",
        f"  block({part});",
        *(f"  memcpy({n} + i * {size}, {n}_part, (size_t)(n - i) * {size} * sizeof(double));" for n, size in rows_out),
        "}",
    ]
    return "\n".join(lines) + "\n"


def _bodies(program: Program, batched: tuple[bool, ...]) -> tuple[list[str], list[str], int]:
    """Statements of `shared_values`, statements of `block`, and how many shared values pass from one to the other."""
    shared_lines: list[str] = []
    block_lines: list[str] = []
    constants: dict[str, float] = {}  # bracketed C text of a constant -> value
    slots: dict[str, int] = {}  # scalar name -> its place in `shared`
    names: dict[int, str] = {}  # work index -> current C name: t* vector, s* shared scalar, else a constant
    sincos: set[str] = set()
    waiting: dict[tuple[int, int], dict[int, str]] = {}  # output quads not yet complete

    def vector(name: str) -> str:
        if name in constants:
            return c_constant(constants[name], "v_")
        if name.startswith("t"):
            return name
        if name not in slots:
            slots[name] = len(slots)
            shared_lines.append(f"shared[{slots[name]}] = {name};")
        return f"v_all(shared[{slots[name]}])"

    for index, i in enumerate(program.instructions):
        match i:
            case Constant(work, value):
                names[work] = c_constant(value)
                constants[names[work]] = value
            case Load(work, port, element) if batched[port]:
                names[work] = f"t{index}"
                width = program.inputs[port].size
                block_lines.append(f"const V t{index} = v_load(a{port} + {element}, {width});")
            case Load(work, port, element):
                names[work] = f"s{index}"
                shared_lines.append(f"const double s{index} = a{port}[{element}];")
            case Operation(work, op, args):
                operands = [names[a] for a in args]
                if not any(name.startswith("t") for name in operands):
                    names[work] = f"s{index}"
                    shared_lines.append(f"const double s{index} = {c_expression(op, operands)};")
                elif op in ("sin", "cos"):
                    angle = operands[0]
                    if angle not in sincos:
                        sincos.add(angle)
                        block_lines.append(f"V {angle}sin, {angle}cos; v_sincos({angle}, &{angle}sin, &{angle}cos);")
                    names[work] = angle + op
                else:
                    names[work] = f"t{index}"
                    text = c_expression(op, [vector(name) for name in operands], "v_")
                    block_lines.append(f"const V t{index} = {text};")
            case Store(work, port, element):
                size = program.outputs[port].size
                quad = waiting.setdefault((port, element // 4), {})
                quad[element] = vector(names[work])
                first = element // 4 * 4
                if len(quad) == min(4, size - first):
                    values = [quad[k] for k in sorted(quad)]
                    if len(values) == 4:
                        block_lines.append(f"v_store4(r{port} + {first}, {size}, {', '.join(values)});")
                    else:
                        block_lines += [f"v_store(r{port} + {k}, {size}, {quad[k]});" for k in sorted(quad)]
    return shared_lines, block_lines, len(slots)
