"""Programs and their C text: every operation against CasADi, and a strict compiler on the embedded form."""

from __future__ import annotations

import ctypes
import itertools
import math
import re
import shutil
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from arms import handling_arm

from symcal.errors import RefusedError
from symcal.kernels import batch_function
from symcal.kernels.compiler import find_compiler
from symcal.kernels.instructions import Operation, Store, c_constant, c_statements, read_program, scalar_definitions

WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"]
COMPILERS = [
    pytest.param(name, marks=pytest.mark.skipif(shutil.which(name) is None, reason=f"no {name} on this machine"))
    for name in ("gcc", "clang")
]


def every_operation() -> ca.Function:
    """One output per operation, of two unrestricted numbers."""
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    unary = [-a, a * a, 2 * a, 1 / a, ca.sqrt(a), ca.sin(a), ca.cos(a), ca.tan(a), ca.asin(a), ca.acos(a), ca.atan(a)]
    unary += [ca.sinh(a), ca.cosh(a), ca.tanh(a), ca.asinh(a), ca.acosh(a), ca.atanh(a), ca.exp(a), ca.expm1(a)]
    unary += [ca.log(a), ca.log1p(a), ca.floor(a), ca.ceil(a), ca.fabs(a), ca.erf(a), ca.sign(a), ca.logic_not(a)]
    binary = [a + b, a - b, a * b, a / b, a < b, a <= b, a == b, a != b, ca.logic_and(a, b), ca.logic_or(a, b)]
    binary += [ca.if_else(a, b, 3), ca.atan2(a, b), a**b, a**2.5, ca.fmin(a, b), ca.fmax(a, b), ca.fmod(a, b)]
    binary += [ca.copysign(a, b), ca.hypot(a, b), a + math.inf, b - 0.1, a * -1e-9]
    return ca.Function("operations", [a, b], [ca.vertcat(*unary, *binary)])


NUMBERS = np.array([0.0, -0.0, 0.5, -0.75, 1.0, -1.0, 2.5, -3.25, 1e3, math.inf, -math.inf, math.nan])
PAIRS = np.array(list(itertools.product(NUMBERS, NUMBERS)))


def reference() -> np.ndarray:
    f = every_operation()
    return np.array([np.array(f(a, b))[:, 0] for a, b in PAIRS])


@pytest.mark.parametrize("backend", ["c", "numpy", "portable"])
@pytest.mark.parametrize("shared", [False, True])
def test_every_operation_in_vectors(shared: bool, backend: str) -> None:
    """Special values included: with b shared, some operations run once, in scalar code or on single numbers."""
    if backend == "c" and find_compiler() is None:
        pytest.skip("no C compiler on this machine")
    f = batch_function(every_operation(), backend=backend)
    assert backend in (f.backend, "portable")
    if shared:
        result = np.empty_like(reference())
        for b in range(NUMBERS.size):
            result[b :: NUMBERS.size] = f(NUMBERS[:, None], NUMBERS[b : b + 1])[0]
    else:
        (result,) = f(PAIRS[:, :1], PAIRS[:, 1:])
    np.testing.assert_allclose(result, reference(), rtol=1e-15)


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(("real", "tolerance"), [("double", 1e-15), ("float", 3e-6)])
def test_every_operation_in_strict_c99(compiler: str, real: str, tolerance: float, tmp_path: Path) -> None:
    library = build(every_operation(), compiler, real, tmp_path)
    number = ctypes.c_double if real == "double" else ctypes.c_float
    result = np.empty(reference().shape)
    for k, (a, b) in enumerate(PAIRS):
        out = (number * result.shape[1])()
        library.operations((number * 1)(a), (number * 1)(b), out)
        result[k] = out
    expected = reference()
    # Outside of float's range, or of functions that magnify the rounding of their argument.
    comparable = np.abs(expected) < 1e4 if real == "float" else np.isfinite(expected)
    np.testing.assert_allclose(result[comparable], expected[comparable], rtol=tolerance, atol=tolerance / 10)
    np.testing.assert_array_equal(np.isnan(result), np.isnan(expected))


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("real", ["double", "float"])
def test_an_arm_in_strict_c99(compiler: str, real: str, tmp_path: Path) -> None:
    library = build(handling_arm(), compiler, real, tmp_path)
    number = np.float64 if real == "double" else np.float32
    pointer = np.ctypeslib.ndpointer(number, flags="C_CONTIGUOUS")
    library.handling.argtypes = [pointer] * 4
    q, x = np.array([0.5, 1100, 250, 1.25, -0.75], dtype=number), np.full(15, 2.0**-7, dtype=number)
    position, jacobian = np.empty(3, dtype=number), np.empty((3, 15), dtype=number)
    library.handling(q, x, position, jacobian)
    p, j = (np.array(v) for v in handling_arm()(q.astype(float), x.astype(float)))
    rtol, atol = (1e-13, 1e-12) if real == "double" else (1e-5, 1e-3)
    np.testing.assert_allclose(position, p[:, 0], rtol=rtol, atol=atol)
    np.testing.assert_allclose(jacobian, j, rtol=rtol, atol=atol)


def build(function: ca.Function, compiler: str, real: str, folder: Path) -> ctypes.CDLL:
    program = read_program(function)
    names = [f"in{i}" for i in range(len(program.inputs))], [f"out{i}" for i in range(len(program.outputs))]
    arguments = ", ".join([*(f"const real *{n}" for n in names[0]), *(f"real *{n}" for n in names[1])])
    body = "\n".join(f"  {line}" for line in c_statements(program, *names))
    head = f"void {program.name}({arguments})"
    source = folder / "f.c"
    source.write_text(f"{scalar_definitions([program])}{head};\n{head} {{\n{body}\n}}\n")
    target = folder / "f.so"
    define = ["-DSYMCAL_FLOAT"] if real == "float" else []
    command = [
        compiler,
        *WARNINGS,
        *define,
        "-O2",
        "-ffp-contract=off",
        "-fPIC",
        "-shared",
        "-o",
        target,
        source,
        "-lm",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(target))


def test_unused_inputs_draw_no_warning_and_work_stays_small() -> None:
    a, b = ca.SX.sym("a", 40), ca.SX.sym("b")
    total = ca.SX(0)
    for k in range(40):
        total = ca.sin(total + a[k])
    program = read_program(ca.Function("f", [a, b], [total]))
    assert "(void)b;" in c_statements(program, ["a", "b"], ["r"])
    assert program.work <= 4
    assert len(program.instructions) > 80


def test_elements_are_counted_row_major() -> None:
    m = ca.SX.sym("m", 2, 3)
    program = read_program(ca.Function("f", [m], [ca.sparsify(ca.SX([[0, 5, 0], [0, 0, 7]])) + 0 * m]))
    values = evaluate_stores(program)
    assert values == {1: 5.0, 5: 7.0, 0: 0.0, 2: 0.0, 3: 0.0, 4: 0.0}


def evaluate_stores(program: object) -> dict[int, float]:
    work: dict[int, float] = {}
    stored: dict[int, float] = {}
    for i in program.instructions:  # type: ignore[attr-defined]
        if isinstance(i, Store):
            stored[i.element] = work[i.work]
        elif not isinstance(i, Operation):
            work[i.work] = getattr(i, "value", 0.0)
        else:
            work[i.work] = math.nan
    return stored


@pytest.mark.parametrize("value", [0.1, -1e-300, 1e22, 3.0, 5e-324, -0.0, 1 / 3])
def test_constants_read_back_exactly(value: float) -> None:
    text = re.fullmatch(r"real_c\((.*)\)", c_constant(value))
    assert text is not None
    assert float(text[1]) == value
    assert re.search(r"[.e]", text[1]), "an integer literal would not take a float suffix"


def test_an_operation_without_c_form_is_named() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(RefusedError, match="OP_ERFINV"):
        read_program(ca.Function("f", [x], [ca.erfinv(x)]))
