"""The compiler, its cache, and what happens when either is missing or broken."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from symcal.kernels import batch_function
from symcal.kernels import compiler as compilers
from symcal.kernels.compiler import find_compiler
from symcal.kernels.own_folder import cache_folder

pytestmark = pytest.mark.skipif(os.name != "posix", reason="these tests replace the compiler by a shell script")
needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="no C compiler on this machine")


def works(factor: float) -> str:
    """Compute with a function of this test's own (`factor` makes its hash) and return the backend that was meant."""
    x = ca.SX.sym("x", 2)
    f = batch_function(ca.Function("f", [x], [factor * ca.sin(x)]))
    angles = np.linspace(-3, 3, 22).reshape(11, 2)
    np.testing.assert_allclose(f(angles)[0], factor * np.sin(angles), rtol=1e-15)
    return f.backend


def script(folder: Path, text: str) -> str:
    path = folder / "mycc"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def test_without_a_compiler(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    caplog.set_level(logging.INFO, "symcal.kernels")
    monkeypatch.setattr(compilers, "_bundled", lambda: None)
    assert works(1.1) == "numpy"
    assert "no C compiler" in caplog.text


def test_cc_variable_is_the_only_choice_when_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "there-is-no-such-compiler -m64")
    assert find_compiler() is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("exit 1", "no C compiler"),
        ('[ "$1" = --version ] && exit 0\necho "internal error" >&2; exit 4', "internal error"),
        ("exit 0", "wrote nothing"),
        ('[ "$1" = --version ] && exit 0\nwhile [ "$1" != -o ]; do shift; done; echo junk > "$2"', "does not load"),
    ],
    ids=["refuses everything", "fails", "writes nothing", "writes junk"],
)
def test_a_broken_compiler(
    text: str, message: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    monkeypatch.setenv("CC", script(tmp_path, text))
    caplog.set_level(logging.INFO, "symcal.kernels")
    works(1.2)
    assert message in caplog.text


@needs_compiler
def test_a_compiler_that_does_not_know_march_native(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    compiler = find_compiler()
    assert compiler is not None
    simple = f'case "$*" in *-march=native*) exit 1;; esac\nexec {compiler.command[0]} "$@"'
    monkeypatch.setenv("CC", script(tmp_path, simple))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert works(1.3) == "c"
    assert len(list((tmp_path / "cache").rglob("*.so"))) == 1


@needs_compiler
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("flags", ["", "-mno-avx512f", "-mno-avx", "-mno-avx512f -mno-fma"])
def test_other_processors(compiler: str, flags: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Narrower vectors, no fused multiply-add: the same results."""
    monkeypatch.setenv("CC", script(tmp_path, f'exec {compiler} "$@" {flags}'))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    if find_compiler() is None or subprocess.run([find_compiler().command[0], "-v"], capture_output=True).returncode:
        pytest.skip(f"{compiler} {flags} is not available")
    x = ca.SX.sym("x", 7)
    f = batch_function(ca.Function("f", [x], [ca.sin(x), ca.horzcat(ca.cos(x), x**3)]), backend="c")
    angles = np.random.default_rng(0).uniform(-1e5, 1e5, (13, 7))
    sine, rest = f(angles)
    np.testing.assert_allclose(sine, np.sin(angles), rtol=0, atol=2.3e-16)
    np.testing.assert_allclose(rest, np.stack([np.cos(angles), angles**3], axis=-1), rtol=1e-14, atol=2.3e-16)
    assert len(list((tmp_path / "cache").rglob("*.so"))) == 1


@needs_compiler
def test_the_second_time_nothing_is_compiled(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    compiler = find_compiler()
    assert compiler is not None
    log = tmp_path / "calls"
    monkeypatch.setenv("CC", script(tmp_path, f'echo "$*" >> {log}\nexec {compiler.command[0]} "$@"'))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for _ in range(3):
        assert works(1.4) == "c"
    assert len(log.read_text().splitlines()) == 2  # its version, and one kernel


@needs_compiler
def test_a_cache_that_cannot_be_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert works(1.5) == "c"


CHILD = """
import casadi as ca, numpy as np
from symcal.kernels import batch_function
from symcal.kernels import compiler as compilers
x = ca.SX.sym("x", 3)
f = batch_function(ca.Function("f", [x], [ca.sin(x) * 1.6]), backend="c")
print(f(np.arange(27.0).reshape(9, 3))[0].tobytes().hex(), f.backend)
"""


@needs_compiler
def test_processes_that_compile_the_same_kernel_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    children = [subprocess.Popen([sys.executable, "-c", CHILD], stdout=subprocess.PIPE, text=True) for _ in range(3)]
    answers = {child.communicate(timeout=60)[0] for child in children}
    assert len(answers) == 1
    assert answers.pop().split()[1] == "c"
    files = list(cache_folder().iterdir())
    assert [f.suffix for f in files] == [".so"]

    # A cached file that became junk is compiled again, in a process that had not loaded it.
    files[0].write_bytes(b"junk")
    again = subprocess.run([sys.executable, "-c", CHILD], capture_output=True, text=True, check=True)
    assert again.stderr == ""
    assert files[0].stat().st_size > 1000
