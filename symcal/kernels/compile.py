"""C source to a loaded shared library, through the user's C compiler and a cache on disk.

Nothing here raises for want of a compiler: whatever goes wrong is logged and answered with None, and the caller
computes without it.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

logger = logging.getLogger(__name__)

# Never -ffast-math: it links start-up code that turns on flush-to-zero for the whole Python process.
FLAGS = ("-std=gnu11", "-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-Wno-psabi")
NATIVE = "-march=native"
TIMEOUT_S = 120.0


@dataclass(frozen=True, slots=True)
class Compiler:
    """A C compiler that answered: its command line and what it calls itself."""

    command: tuple[str, ...]
    version: str


def find_compiler() -> Compiler | None:
    """The C compiler of this machine: the CC variable if set (and then no other), else cc, gcc or clang on the PATH."""
    return _find_compiler(os.environ.get("CC", ""), os.environ.get("PATH", ""))


@cache
def _find_compiler(cc: str, path: str) -> Compiler | None:
    for command in [shlex.split(cc)] if cc.strip() else [["cc"], ["gcc"], ["clang"]]:
        program = shutil.which(command[0], path=path)
        if program is None:
            continue
        full = (program, *command[1:])
        answer = _run([*full, "--version"])
        if answer is not None:
            return Compiler(full, answer)
    return None


def _run(command: list[str]) -> str | None:
    """Standard output of a command; None, and a log entry, if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=TIMEOUT_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        logger.info("%s: %s", command[0], error)
        return None
    if done.returncode != 0:
        logger.info("%s failed with %d: %s", command[0], done.returncode, done.stderr[-2000:])
        return None
    return done.stdout


@cache
def _processor() -> str:
    """What -march=native may depend on: a home directory can be shared by machines that differ."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    wanted = ("model name", "flags", "features", "cpu family", "model", "cpu part", "isa")
    first = text.split("\n\n", 1)[0].splitlines()
    return "\n".join(line for line in first if line.split(":")[0].strip().lower() in wanted)


def cache_folder() -> Path:
    """Where compiled kernels are kept; safe to delete at any time."""
    if "XDG_CACHE_HOME" in os.environ:
        return Path(os.environ["XDG_CACHE_HOME"]) / "symcal" / "kernels"
    if sys.platform == "win32" and "LOCALAPPDATA" in os.environ:
        return Path(os.environ["LOCALAPPDATA"]) / "symcal" / "cache" / "kernels"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "symcal" / "kernels"
    return Path.home() / ".cache" / "symcal" / "kernels"


def load_library(source: str, optimisation: str) -> ctypes.CDLL | None:
    """Compile C source (or find it compiled) and load it.

    Args:
        source: C text; the whole of it, since its hash is the key of the cache.
        optimisation: `-O1` .. `-O3`.
    Returns:
        the library, or None if there is no compiler or it failed (the log says how).
    """
    compiler = find_compiler()
    if compiler is None:
        logger.info("no C compiler found (CC, cc, gcc, clang)")
        return None
    flags = (optimisation, *FLAGS)
    key = "\0".join([source, *flags, *compiler.command, compiler.version, _processor(), platform.platform()])
    name = f"{hashlib.sha256(key.encode()).hexdigest()[:32]}{'.dll' if sys.platform == 'win32' else '.so'}"
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        return _load(folder / name) or _build(compiler, flags, source, folder / name)
    except (OSError, RuntimeError) as error:  # no home, or a cache that is full or read-only
        logger.info("kernel cache unusable: %s", error)
    with tempfile.TemporaryDirectory(prefix="symcal", ignore_cleanup_errors=True) as scratch:
        return _build(compiler, flags, source, Path(scratch) / name)


def _load(path: Path) -> ctypes.CDLL | None:
    if not path.exists():
        return None
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        logger.info("compiled kernel %s does not load: %s", path, error)
        return None


def _build(compiler: Compiler, flags: tuple[str, ...], source: str, path: Path) -> ctypes.CDLL | None:
    """Compile beside the target and rename: another process sees the whole file or none."""
    with tempfile.TemporaryDirectory(prefix="build", dir=path.parent, ignore_cleanup_errors=True) as scratch:
        text, built = Path(scratch) / "kernel.c", Path(scratch) / path.name
        text.write_text(source, encoding="utf-8")
        for native in ((NATIVE,), ()):  # some compilers know no -march=native
            if _run([*compiler.command, *flags, *native, "-o", str(built), str(text), "-lm"]) is not None:
                break
        else:
            logger.warning("the C compiler %s failed; kernels run in CasADi's virtual machine", compiler.command[0])
            return None
        if not built.exists():
            logger.warning(
                "the C compiler %s wrote nothing; kernels run in CasADi's virtual machine", compiler.command[0]
            )
            return None
        built.replace(path)
    library = _load(path)
    if library is None:
        logger.warning(
            "what the C compiler %s wrote does not load; kernels run in CasADi's virtual machine", compiler.command[0]
        )
        path.unlink(missing_ok=True)
    return library
