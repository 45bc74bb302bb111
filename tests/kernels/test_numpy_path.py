"""The path without a compiler: nothing but a row decides on its bits, and threads do not meet in its buffers."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest
from arms import handling_arm, seven_joint_arm

from symcal.kernels import batch_function
from symcal.kernels.numpy_operations import ROUNDED
from symcal.kernels.straight_line import BLOCK

TWO = {"atan2": ca.atan2, "pow": lambda a, b: a**b, "fmod": ca.fmod, "hypot": ca.hypot}


def function_of(op: str, shared: bool) -> ca.Function:
    """An operation whose operand and result go through registers as well: 2 op(3 a) + 1."""
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    value = TWO[op](3 * a, b) if op in TWO else getattr(ca, op)(3 * a)
    direct = TWO[op](a, b) if op in TWO else getattr(ca, op)(a)
    return ca.Function("f", [a, b], [2 * value + 1 + (0 if shared else b), direct])


@pytest.mark.parametrize("op", sorted(ROUNDED))
@pytest.mark.parametrize("shared", [False, True])
def test_a_function_gives_the_same_bits_at_any_place_in_a_batch_of_any_size(op: str, shared: bool) -> None:
    """numpy computes some functions in vectors and what is left over in another way, with another last bit."""
    f = batch_function(function_of(op, shared), backend="numpy")
    rng = np.random.default_rng(0)
    low, high = {"acosh": (1.0, 9.0), "log": (0.01, 9.0), "pow": (0.01, 9.0)}.get(op, (-0.33, 0.33))
    a = rng.uniform(low, high, (2 * BLOCK + 77, 1))
    b = np.array([0.7]) if shared else rng.uniform(0.1, 2, a.shape)
    whole = f(a, b)
    for start, stop in [
        (k, k + n) for n in (1, 2, 3, 5, 8, 17, 63) for k in (0, 1, 2, 3, 7, BLOCK - 2, 2 * BLOCK + 13)
    ]:
        part = f(a[start:stop], b if shared else b[start:stop])
        for one, all_of_them in zip(part, whole, strict=True):
            np.testing.assert_array_equal(one, all_of_them[start:stop])


@pytest.mark.parametrize("portable", [False, True])
@pytest.mark.parametrize("n", [BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 5])
def test_every_block_of_an_arm_is_computed(n: int, portable: bool) -> None:
    rng = np.random.default_rng(n)
    q, x = rng.uniform(-3, 3, (n, 5)), rng.normal(0, 0.01, 15)
    vm, own = (batch_function(handling_arm(), backend=b) for b in ("vm", "portable" if portable else "numpy"))
    for result, wanted in zip(own(q, x), vm(q, x), strict=True):
        np.testing.assert_allclose(result, wanted, rtol=1e-13, atol=1e-11)


def test_threads_have_buffers_of_their_own() -> None:
    f = batch_function(seven_joint_arm(), backend="numpy")
    rng = np.random.default_rng(1)
    jobs = [(rng.uniform(-3, 3, (700, 7)), rng.normal(0, 0.01, 40)) for _ in range(12)]
    alone = [f(*job) for job in jobs]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda job: f(*job), jobs * 3))
    for results, wanted in zip(together, alone * 3, strict=True):
        for result, one in zip(results, wanted, strict=True):
            np.testing.assert_array_equal(result, one)


def test_no_names_of_a_function_are_in_what_is_run() -> None:
    """Names come from files; CasADi restricts them, and still none is used."""
    q = ca.SX.sym("q; import os", 2)
    f = batch_function(ca.Function("do_not_run", [q], [ca.sin(q)], ["os"], ["exit"]), backend="numpy")
    from symcal.kernels.straight_line import _written

    source = _written(f.program, (True,), False).source()
    assert all(name not in source for name in ("do_not_run", "os", "exit", "import"))
    np.testing.assert_allclose(f(np.ones((3, 2)))[0], np.full((3, 2), np.sin(1.0)), rtol=1e-15)
