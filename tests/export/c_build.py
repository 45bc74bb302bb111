"""Compilers and build programs for the tests of exported C, which skip where there are none."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from symcal.kernels.compiler import find_compiler

STRICT = "-Wall -Wextra -Wpedantic -Wconversion -Wdouble-promotion -Wshadow -Werror"

needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="no C compiler on this machine")
needs_make = pytest.mark.skipif(
    shutil.which("make") is None or shutil.which("cc") is None, reason="no make or cc on this machine"
)
COMPILERS = [
    pytest.param(name, marks=pytest.mark.skipif(shutil.which(name) is None, reason=f"no {name} on this machine"))
    for name in ("gcc", "clang")
]


def succeed(*command: object, cwd: Path) -> str:
    """What a command printed; the test fails with all of it if the command does."""
    done = subprocess.run([str(c) for c in command], cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def self_test(folder: Path, compiler: str = "cc", optimisation: str = "-O2") -> str:
    """Build and run the exported self-test, in double and in float, with every warning an error."""
    return succeed("make", "test", f"CC={compiler}", f"CFLAGS={optimisation}", f"WARNINGS={STRICT}", cwd=folder)
