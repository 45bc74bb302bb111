"""Arrays that are filled in place, and calls that are prepared once: the same bits as a plain call."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from arms import handling_arm

from symcal.errors import InputError
from symcal.kernels import batch_function
from symcal.kernels.compiler import find_compiler

BACKENDS = ["vm", "numpy", "portable"] + (["c"] if find_compiler() is not None else [])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("n", [1, 7, 40])
def test_given_arrays_are_filled(backend: str, n: int) -> None:
    f = batch_function(handling_arm(), backend=backend)
    q, x = np.random.default_rng(0).uniform(-3, 3, (n, 5)), np.full(15, 0.01)
    wanted = f(q, x)
    beyond = np.full((n + 2, 3), 7.0)
    out = (beyond[1:-1], np.empty((n, 3, 15)))
    results = f(q, x, out=out)
    assert all(result is array for result, array in zip(results, out, strict=True))
    for result, plain in zip(results, wanted, strict=True):
        np.testing.assert_array_equal(result, plain)
    np.testing.assert_array_equal(beyond[[0, -1]], 7.0)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_prepared_call_reads_its_arguments_anew(backend: str) -> None:
    f = batch_function(handling_arm(), backend=backend)
    rng = np.random.default_rng(1)
    q, x = rng.uniform(-3, 3, (11, 5)), np.zeros(15)
    call = f.prepared(q, x)
    assert call.arguments[1] is x
    for _ in range(3):
        x[:] = rng.normal(0, 0.01, 15)
        q[:] = rng.uniform(-3, 3, q.shape)
        results = call()
        assert results is call.results
        for result, plain in zip(results, f(q, x), strict=True):
            np.testing.assert_array_equal(result, plain)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_prepared_call_copies_what_it_cannot_read_in_place(backend: str) -> None:
    f = batch_function(handling_arm(), backend=backend)
    q = np.asfortranarray(np.random.default_rng(2).uniform(-3, 3, (6, 5)))
    call = f.prepared(q, np.zeros(15, dtype=int))
    assert not np.shares_memory(call.arguments[0], q)
    np.testing.assert_array_equal(call()[0], f(q, np.zeros(15))[0])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("prepared", [False, True])
def test_without_rows_and_without_a_batch(backend: str, prepared: bool) -> None:
    f = batch_function(handling_arm(), backend=backend)
    for q, lead in ((np.empty((0, 5)), (0,)), (np.full(5, 0.3), ())):
        out = (np.zeros((*lead, 3)), np.zeros((*lead, 3, 15)))
        x = np.zeros(15)
        results = f.prepared(q, x, out=out)() if prepared else f(q, x, out=out)
        for result, plain, given in zip(results, f(q, x), out, strict=True):
            np.testing.assert_array_equal(result, plain)
            assert np.shares_memory(result, given) or not given.size


@pytest.mark.parametrize("prepared", [False, True])
@pytest.mark.parametrize(
    ("out", "message"),
    [
        ([np.empty((4, 3))], "these shapes"),
        ([np.empty((4, 3)), np.empty((4, 15, 3))], "these shapes"),
        ([np.empty((4, 3)), np.empty((4, 3, 15), dtype=np.float32)], "float64"),
        ([np.empty((4, 3)), np.empty((4, 15, 3)).swapaxes(1, 2)], "C-contiguous"),
        ([[[0.0] * 3] * 4, np.empty((4, 3, 15))], "these shapes"),
    ],
)
def test_arrays_that_cannot_be_filled(out: list[np.ndarray], message: str, prepared: bool) -> None:
    f = batch_function(handling_arm(), backend="vm")
    with pytest.raises(InputError, match=message):
        (f.prepared if prepared else f)(np.zeros((4, 5)), np.zeros(15), out=out)


def test_an_array_that_is_read_and_filled_at_once_is_refused() -> None:
    x = ca.SX.sym("x", 2)
    f = batch_function(ca.Function("f", [x], [ca.vertcat(x[1], x[0])]), backend="vm")
    both = np.ones((4, 2))
    with pytest.raises(InputError, match="shares memory"):
        f(both, out=[both])
    locked = np.ones((4, 2))
    locked.flags.writeable = False
    with pytest.raises(InputError, match="writeable"):
        f(both, out=[locked])
