"""Batched evaluation against one plain call of the CasADi function per row, and against libm."""

from __future__ import annotations

import math
import pickle

import casadi as ca
import numpy as np
import pytest
from arms import handling_arm, seven_joint_arm
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from symcal.errors import InputError, RefusedError
from symcal.kernels import BatchFunction, batch_function
from symcal.kernels.compiler import find_compiler
from symcal.kernels.path import WORTH_COMPILING, WORTH_WRITING, Kind

COMPILES = find_compiler() is not None
needs_compiler = pytest.mark.skipif(not COMPILES, reason="no C compiler on this machine")
BACKENDS = ["vm", "numpy", pytest.param("c", marks=needs_compiler), "portable"]


def one_by_one(function: ca.Function, n: int, *args: np.ndarray) -> list[np.ndarray]:
    """The definition: row k of every batched argument, shared ones as they are."""
    results = []
    for k in range(n):
        row = []
        for i, arg in enumerate(args):
            rows, cols = function.size_in(i)
            one = arg[k] if arg.ndim > (1 if cols == 1 else 2) else arg
            row.append(ca.DM(one.reshape(rows, cols)))
        results.append([np.array(ca.densify(r)) for r in function.call(row)])
    return [np.array([r[j] for r in results]) for j in range(function.n_out())]


def mixed() -> ca.Function:
    """Vector, matrix, scalar and sparse inputs and outputs, a constant output and one of shared values only."""
    v, m, s = ca.SX.sym("v", 3), ca.SX.sym("m", 2, 3), ca.SX.sym("s")
    p = ca.SX.sym("p", ca.Sparsity.lower(2))
    unused = ca.SX.sym("unused", 4)
    outputs = [m @ v, ca.vertcat(m * s, v.T), s * v[0], p @ p.T, ca.sparsify(ca.diag(v)), ca.SX([1.5, -2.0])]
    return ca.Function("mixed", [v, m, s, p, unused], [*outputs, ca.sin(p)])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("n", [1, 2, 7, 8, 9, 300])
def test_shapes_and_values_of_every_kind_of_port(backend: str, n: int) -> None:
    rng = np.random.default_rng(n)
    f = batch_function(mixed(), backend=backend)
    v, m = rng.normal(size=(n, 3)), rng.normal(size=(n, 2, 3))
    s, p, unused = rng.normal(size=1), rng.normal(size=(2, 2)), np.zeros(4)
    results = f(v, m, s, p, unused)
    assert f.kind == Kind("c" if backend == "portable" and COMPILES else backend, backend == "portable")
    expected = one_by_one(mixed(), n, v, m, s, p, unused)
    shapes = [(n, 2), (n, 3, 3), (n, 1), (n, 2, 2), (n, 3, 3), (n, 2), (n, 2, 2)]
    for result, wanted, shape in zip(results, expected, shapes, strict=True):
        assert result.shape == shape
        assert result.flags.c_contiguous
        np.testing.assert_allclose(result, wanted.reshape(shape), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("n", [1, 7, 8, 9, 1000])
@pytest.mark.parametrize("shared", [(False, True), (True, False), (False, False)])
def test_arm_and_its_jacobian(backend: str, n: int, shared: tuple[bool, bool]) -> None:
    rng = np.random.default_rng(0)
    q = rng.uniform(-3, 3, 5 if shared[0] else (n, 5))
    x = rng.normal(0, 0.01, 15 if shared[1] else (n, 15))
    position, jacobian = batch_function(handling_arm(), backend=backend)(q, x)
    assert position.shape == (n, 3)
    assert jacobian.shape == (n, 3, 15)
    sample = slice(max(0, n - 30), n)
    args = [a if once else a[sample] for a, once in zip((q, x), shared, strict=True)]
    p, j = one_by_one(handling_arm(), min(n, 30), *args)
    np.testing.assert_allclose(position[sample], p[..., 0], rtol=1e-13, atol=1e-11)
    np.testing.assert_allclose(jacobian[sample], j, rtol=1e-13, atol=1e-11)


def test_the_arm_of_the_paper_stands_where_it_should() -> None:
    position, _ = batch_function(handling_arm())(np.array([[math.pi / 4, 1100, 0, math.pi / 2, 0]]), np.zeros(15))
    np.testing.assert_allclose(position[0], [-229.81, 194.454, 1100], atol=5e-3)


@needs_compiler
def test_a_long_function() -> None:
    rng = np.random.default_rng(1)
    q, x = rng.uniform(-3, 3, (50, 7)), rng.normal(0, 0.01, 40)
    vm, *others = [batch_function(seven_joint_arm(), backend=b)(q, x) for b in ("vm", "c", "numpy", "portable")]
    for results in others:
        for result, wanted in zip(results, vm, strict=True):
            np.testing.assert_allclose(result, wanted, rtol=1e-13, atol=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_no_rows(backend: str) -> None:
    position, jacobian = batch_function(handling_arm(), backend=backend)(np.empty((0, 5)), np.zeros(15))
    assert position.shape == (0, 3)
    assert jacobian.shape == (0, 3, 15)


@pytest.mark.parametrize("backend", BACKENDS)
def test_no_batched_argument_gives_no_batch_axis(backend: str) -> None:
    q, x = np.full(5, 0.3), np.zeros(15)
    f = batch_function(handling_arm(), backend=backend)
    position, jacobian = f(q, x)
    assert position.shape == (3,)
    assert jacobian.shape == (3, 15)
    np.testing.assert_allclose(position, f(q[None], x)[0][0], rtol=1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
def test_empty_ports(backend: str) -> None:
    a, none = ca.SX.sym("a", 2), ca.SX.sym("none", 0)
    f = batch_function(ca.Function("f", [a, none], [none, 2 * a]), backend=backend)
    nothing, twice = f(np.ones((9, 2)), np.empty(0))
    assert nothing.shape == (9, 0)
    np.testing.assert_array_equal(twice, np.full((9, 2), 2.0))


@pytest.mark.parametrize("backend", BACKENDS)
def test_any_memory_layout_and_read_only_arguments(backend: str) -> None:
    rng = np.random.default_rng(2)
    f = batch_function(mixed(), backend=backend)
    v, m = np.asfortranarray(rng.normal(size=(18, 3))), np.asfortranarray(rng.normal(size=(18, 2, 3)))
    rest = (np.ones(1), np.ones((2, 2)), np.zeros(4))
    m.flags.writeable = False
    reversed_twice = f(v[::-2], m[::-2], *rest)
    contiguous = f(v[::-2].copy("C"), m[::-2].copy("C"), *rest)
    for a, b in zip(reversed_twice, contiguous, strict=True):
        np.testing.assert_array_equal(a, b)
    integers = f(np.ones((2, 3), dtype=int), m[:2], *rest)
    np.testing.assert_array_equal(integers[0], f(np.ones((2, 3)), m[:2], *rest)[0])


@pytest.mark.parametrize("backend", BACKENDS)
def test_results_are_the_callers_own(backend: str) -> None:
    f = batch_function(handling_arm(), backend=backend)
    q = np.random.default_rng(3).uniform(-1, 1, (9, 5))
    first = f(q, np.zeros(15))[0]
    kept = first.copy()
    f(q + 1, np.zeros(15))
    np.testing.assert_array_equal(first, kept)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_row_depends_on_itself_alone_to_the_last_bit(backend: str) -> None:
    """Neither N, nor the place in a block, nor a neighbour that is NaN or far away."""
    f = batch_function(handling_arm(), backend=backend)
    q = np.random.default_rng(4).uniform(-3, 3, (43, 5))
    whole = f(q, np.zeros(15))[1]
    for n in (1, 3, 8, 17):
        np.testing.assert_array_equal(f(q[-n:], np.zeros(15))[1], whole[-n:])
    disturbed = q.copy()
    disturbed[::3] = np.nan
    disturbed[1::3] = 1e9
    np.testing.assert_array_equal(f(disturbed, np.zeros(15))[1][2::3], whole[2::3])


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ((np.zeros((4, 5)),), "takes 2 arguments, not 1"),
        ((np.zeros((4, 6)), np.zeros(15)), r"'q' has shape \(4, 6\); wanted \(5,\) \(shared\) or \(N, 5\)"),
        ((np.zeros((4, 5, 1)), np.zeros(15)), r"'q' has shape \(4, 5, 1\)"),
        ((np.zeros((4, 5)), np.zeros((3, 15))), "different numbers of rows"),
    ],
)
def test_wrong_arguments(args: tuple[np.ndarray, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        batch_function(handling_arm(), backend="vm")(*args)


@needs_compiler
def test_another_process_gets_the_same_function() -> None:
    f = batch_function(handling_arm(), backend="c")
    q = np.random.default_rng(5).uniform(-3, 3, (5, 5))
    before = f(q, np.zeros(15))
    again: BatchFunction = pickle.loads(pickle.dumps(f))
    assert again.backend == "c"
    for a, b in zip(before, again(q, np.zeros(15)), strict=True):
        np.testing.assert_array_equal(a, b)


def test_choice_of_backend(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = handling_arm()
    possible = "c" if COMPILES else "numpy"
    assert batch_function(arm).backend == possible
    assert batch_function(arm, evaluations=WORTH_COMPILING).backend == possible
    assert batch_function(arm, evaluations=WORTH_COMPILING - 1).backend == "numpy"
    assert batch_function(arm, evaluations=WORTH_WRITING - 1).backend == "vm"
    monkeypatch.setenv("SYMCAL_KERNELS", "c")
    assert batch_function(arm, evaluations=1).backend == possible
    assert batch_function(arm, backend="vm").backend == "vm"
    monkeypatch.setenv("SYMCAL_KERNELS", "portable")
    assert batch_function(arm).kind == Kind(possible, portable=True)
    assert batch_function(arm, evaluations=0).kind == Kind("numpy", portable=True)
    monkeypatch.setenv("SYMCAL_KERNELS", "vm")
    assert batch_function(arm).backend == "vm"
    monkeypatch.setenv("SYMCAL_KERNELS", "fast")
    with pytest.raises(InputError, match="fast"):
        batch_function(arm)


def test_what_has_no_c_form_runs_in_the_virtual_machine() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    f = batch_function(ca.Function("f", [x], [ca.erfinv(x)]), backend="c")
    assert f.backend == "vm"
    np.testing.assert_allclose(f(np.array([[0.5]]))[0], [[0.4769362762044699]], rtol=1e-9)
    root = batch_function(ca.rootfinder("root", "newton", {"x": x, "p": y, "g": x**2 - y}), backend="c")
    assert root.backend == "vm"
    np.testing.assert_allclose(root(np.ones(1), np.array([[2.0], [3.0]]))[0] ** 2, [[2], [3]], rtol=1e-12)


def test_a_function_too_long_to_compile_runs_in_the_virtual_machine() -> None:
    x = ca.SX.sym("x", 15_000)
    f = batch_function(ca.Function("f", [x], [2 * x]), backend="c")
    assert f.backend == "vm"
    np.testing.assert_array_equal(f(np.ones((3, 15_000)))[0], np.full((3, 15_000), 2.0))


def test_what_has_no_scalar_form_is_refused() -> None:
    m = ca.MX.sym("m", 2, 2)
    with pytest.raises(RefusedError, match="'inverse' cannot be expanded"):
        batch_function(ca.Function("inverse", [m], [ca.inv(m)]))


@needs_compiler
def test_sine_and_cosine_are_those_of_libm() -> None:
    a = ca.SX.sym("a")
    f = batch_function(ca.Function("f", [a], [ca.sin(a), ca.cos(a)]), backend="c")
    rng = np.random.default_rng(6)
    quarters = np.arange(-60000, 60000, 7) * (math.pi / 2)
    near = [
        quarters,
        np.nextafter(quarters, 0),
        np.nextafter(quarters, 1e9),
        quarters + rng.normal(0, 1e-6, quarters.size),
    ]
    tiny = [0.0, -0.0, 5e-324, -1e-310, 1e-200, 1e-17, 1e-9]
    angles = np.concatenate([*near, rng.uniform(-7, 7, 30000), rng.uniform(-1e5, 1e5, 30000), tiny])
    sine, cosine = (r[:, 0] for r in f(angles[:, None]))
    exact_sine = np.array([math.sin(v) for v in angles])
    assert np.max(np.abs(sine - exact_sine)) < 2.3e-16
    assert np.max(np.abs(cosine - np.array([math.cos(v) for v in angles]))) < 2.3e-16
    # Small results are right relatively too: near a multiple of pi nothing has cancelled.
    np.testing.assert_allclose(sine, exact_sine, rtol=4.5e-16, atol=0)
    np.testing.assert_array_equal(np.signbit(sine), np.signbit(exact_sine))

    far = np.array([1e5, 1.0000001e5, -3e5, 2.0**53, 1e22, -1e300])
    sine, cosine = (r[:, 0] for r in f(far[:, None]))
    np.testing.assert_array_equal(sine, [math.sin(v) for v in far])
    np.testing.assert_array_equal(cosine, [math.cos(v) for v in far])
    for result in f(np.array([[np.nan], [np.inf], [-np.inf]])):
        assert np.all(np.isnan(result))


@st.composite
def graphs(draw: st.DrawFn, *, libm: bool = True) -> ca.Function:
    """A random expression of two inputs whose values stay within +-2 and whose rounding errors do not grow.

    Args:
        libm: whether it has functions that are left to the C library.
    """
    a, b = ca.SX.sym("a", 3), ca.SX.sym("b", 2)
    nodes = [*ca.vertsplit(a), *ca.vertsplit(b), ca.SX(draw(st.floats(-2, 2)))]
    unary = [ca.sin, ca.cos, ca.fabs, lambda u: -u, lambda u: ca.sqrt(1 + u * u) / 2]
    unary += [lambda u: 1 / (2 + ca.cos(u)), lambda u: u**2 / 4]
    if libm:
        unary += [ca.tanh, ca.atan, lambda u: ca.exp(-u * u), lambda u: ca.log(2 + ca.sin(u))]
    binary = [lambda u, v: (u + v) / 2, lambda u, v: (u - v) / 2, lambda u, v: u * v / 4, ca.fmin, ca.fmax]
    binary += [lambda u, v: ca.if_else(u < 100, v, u), lambda u, v: u / (4 + v)]
    if libm:
        binary += [lambda u, v: ca.atan2(u, 3 + v) / 2]
    for _ in range(draw(st.integers(1, 25))):
        u, v = (nodes[draw(st.integers(0, len(nodes) - 1))] for _ in range(2))
        if draw(st.booleans()):
            nodes.append(draw(st.sampled_from(unary))(u))
        else:
            nodes.append(draw(st.sampled_from(binary))(u, v))
    rows = draw(st.integers(1, 3))
    matrix = ca.reshape(ca.vertcat(*(nodes * 6)[-6 * rows :]), rows, 6)
    return ca.Function("graph", [a, b], [ca.vertcat(*nodes), matrix])


@needs_compiler
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(graphs(), st.integers(0, 2**32 - 1))
def test_all_backends_agree_on_any_expression(graph: ca.Function, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-2, 2, (11, 3)), rng.uniform(-2, 2, 2)
    vm = batch_function(graph, backend="vm")(a, b)
    for backend in ("c", "numpy", "portable"):
        for x, y in zip(vm, batch_function(graph, backend=backend)(a, b), strict=True):
            np.testing.assert_allclose(y, x, rtol=1e-13, atol=1e-14)
