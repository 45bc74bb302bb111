"""Which code runs, what it is called, and the level whose bits are the same everywhere."""

from __future__ import annotations

import importlib
import logging
import os
import pickle
import sys
from importlib.util import find_spec
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from arms import handling_arm, seven_joint_arm
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_batch import graphs

from symcal.errors import InputError
from symcal.kernels import batch_function, compile, path_in_use
from symcal.kernels import compiler as compilers
from symcal.kernels.compiled import Compiled
from symcal.kernels.compiler import Compiler, find_compiler
from symcal.kernels.numpy_operations import SINCOS_RANGE, sincos

COMPILES = find_compiler() is not None
needs_compiler = pytest.mark.skipif(not COMPILES, reason="no C compiler on this machine")
posix = pytest.mark.skipif(os.name != "posix", reason="a compiler is faked by a shell script")


def tool(folder: Path, name: str) -> None:
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(f"#!/bin/sh\necho {name} 1.2 $1\n")
    (folder / name).chmod(0o755)


@posix
def test_the_order_of_compilers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """CC, cc, gcc, clang, Zig's: each is taken when the ones before it are gone."""
    bin_ = tmp_path / "bin"
    for name in ("cc", "gcc", "clang", "own"):
        tool(bin_, name)
    tool(tmp_path / "ziglang", "zig")
    (tmp_path / "ziglang" / "__init__.py").write_text("raise RuntimeError('the package itself is never imported')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/bin:/usr/bin")
    monkeypatch.setattr(compilers.shutil, "which", lambda name, **_: str(p) if (p := bin_ / name).exists() else None)
    importlib.invalidate_caches()
    found = []
    for gone in (None, "own", "cc", "gcc", "clang"):
        if gone:
            (bin_ / gone).unlink()
        monkeypatch.setenv("CC", "own -m64" if gone is None else "")
        compilers._find_compiler.cache_clear()
        found.append(find_compiler())
    compilers._find_compiler.cache_clear()
    assert [Path(each.command[0]).name for each in found] == ["own", "cc", "gcc", "clang", "zig"]
    assert [each.bundled for each in found] == [False] * 4 + [True]
    assert found[0].command[1:] == ("-m64",)
    assert found[-1].command[1:] == ("cc",)
    assert found[-1].name == "zig's zig 1.2 cc"
    assert "ziglang" not in sys.modules


@posix
def test_a_compiler_asked_for_by_name_is_not_replaced(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    tool(tmp_path / "ziglang", "zig")
    (tmp_path / "ziglang" / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("CC", "there-is-no-such-compiler")
    compilers._find_compiler.cache_clear()
    assert find_compiler() is None
    compilers._find_compiler.cache_clear()


def of_this_machine(name: str) -> Compiler | None:
    """A compiler of this machine by name."""
    if name == "ziglang":
        return compilers._bundled()
    program = compilers.shutil.which(name)
    return None if program is None else Compiler((program,), compilers.run([program, "--version"], 5.0, keep="stdout"))


@pytest.mark.parametrize("name", ["gcc", "clang", "ziglang"])
@pytest.mark.parametrize("optimisation", ["-O1", "-O2", "-O3"])
def test_portable_bits_are_the_same_from_any_compiler_and_from_numpy(
    name: str, optimisation: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    compiler = of_this_machine(name)
    if compiler is None:
        pytest.skip(f"{name} is not installed here")
    if name != "ziglang":  # whose cache takes long to fill, and is the same for all
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(compile, "find_compiler", lambda: compiler)
    monkeypatch.setattr("symcal.kernels.path.find_compiler", lambda: compiler)
    monkeypatch.setattr(
        "symcal.kernels.compiled.load_library",
        lambda source, _, entry, portable: compile.load_library(source, optimisation, entry, portable=portable),
    )
    rng = np.random.default_rng(0)
    arms = ((handling_arm(), 5, 15), (seven_joint_arm(), 7, 40))
    # the long one keeps a compiler busy for seconds: at the lowest level and at the highest
    for function, joints, errors in arms[:1] if optimisation == "-O2" else arms:
        q, x = rng.uniform(-3, 3, (531, joints)), rng.normal(0, 0.01, errors)
        q[::50] *= 1e3
        c = batch_function(function, backend="portable")
        assert (c.kind.backend, c.kind.portable) == ("c", True)
        plain = batch_function(function, backend="portable", evaluations=0)
        assert plain.kind.backend == "numpy"
        for compiled, own in zip(c(q, x), plain(q, x), strict=True):
            np.testing.assert_array_equal(compiled, own)
        assert all(isinstance(run, Compiled) for run in c._runs.values())


@pytest.mark.skipif(find_spec("ziglang") is None, reason="the package ziglang is not installed here")
def test_the_compiler_that_comes_as_a_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    compiler = find_compiler()
    assert compiler is not None
    assert compiler.bundled
    f, vm = (batch_function(handling_arm(), backend=b) for b in ("c", "vm"))
    q, x = np.random.default_rng(3).uniform(-3, 3, (43, 5)), np.full(15, 0.01)
    for result, wanted in zip(f(q, x), vm(q, x), strict=True):
        np.testing.assert_allclose(result, wanted, rtol=1e-13, atol=1e-11)
    assert all(isinstance(run, Compiled) for run in f._runs.values())
    assert "zig" in str(path_in_use())


@needs_compiler
@settings(max_examples=5, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(graphs(libm=False), st.integers(0, 2**32 - 1))
def test_portable_bits_of_any_expression(graph: ca.Function, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-2, 2, (11, 3)), rng.uniform(-2, 2, 2)
    c, plain = batch_function(graph, backend="portable"), batch_function(graph, backend="portable", evaluations=0)
    assert (c.backend, plain.backend) == ("c", "numpy")
    for x, y in zip(c(a, b), plain(a, b), strict=True):
        np.testing.assert_array_equal(x, y)


def test_our_own_sines_in_numpy() -> None:
    rng = np.random.default_rng(1)
    far = np.array([SINCOS_RANGE, -3e5, 1e22])
    angles = np.concatenate([rng.uniform(-9, 9, 5000), rng.uniform(-1e5, 1e5, 5000), [0.0, -0.0, 5e-324], far])
    sine, cosine = sincos(angles)
    np.testing.assert_allclose(sine, np.sin(angles), rtol=4.5e-16, atol=0)
    np.testing.assert_allclose(cosine, np.cos(angles), rtol=0, atol=2.3e-16)
    np.testing.assert_array_equal(np.signbit(sine), np.signbit(np.sin(angles)))
    with np.errstate(invalid="ignore"):
        assert np.all(np.isnan(sincos(np.array([np.nan, np.inf, -np.inf]))))


def test_a_portable_function_in_another_process() -> None:
    f = batch_function(handling_arm(), backend="portable")
    again = pickle.loads(pickle.dumps(f))
    assert again.kind == f.kind
    q = np.random.default_rng(2).uniform(-3, 3, (5, 5))
    np.testing.assert_array_equal(again(q, np.zeros(15))[1], f(q, np.zeros(15))[1])


@needs_compiler
@pytest.mark.parametrize("choice", ["c", "portable", "numpy", "vm"])
def test_the_path_in_use(choice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SYMCAL_KERNELS", choice)
    path = path_in_use()
    assert path.facts()["backend"] == path.backend == ("c" if choice == "portable" else choice)
    assert path.portable == (choice == "portable")
    assert np.__version__ in path.bits
    assert ca.__version__ in path.libraries
    assert (find_compiler().name in str(path)) == (path.backend == "c")
    assert (path.processor in path.bits) == (not path.portable)
    if choice == "c":
        assert path.instructions.split()[0] in ("4", "8")


@needs_compiler
def test_portable_paths_with_and_without_a_compiler_promise_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    with_compiler = path_in_use("portable")
    monkeypatch.setattr("symcal.kernels.path.find_compiler", lambda: None)
    without = path_in_use("portable")
    assert (with_compiler.backend, without.backend) == ("c", "numpy")
    assert with_compiler.bits == without.bits
    assert path_in_use("c").bits != without.bits


def test_the_path_is_said_once(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr("symcal.kernels.path.find_compiler", lambda: None)
    caplog.set_level(logging.INFO, "symcal.kernels")
    for _ in range(3):
        batch_function(handling_arm())
    (said,) = [r.message for r in caplog.records if r.message.startswith("kernels:")]
    assert "numpy" in said
    assert "symcal[fast]" in said


def test_an_unknown_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SYMCAL_KERNELS", "fastest")
    with pytest.raises(InputError, match="fastest"):
        path_in_use()
