"""C source to a loaded shared library, through the user's C compiler and a cache on disk.

A library runs as soon as it is loaded, and one that breaks off before its end kills the process. So a file is loaded
only from a folder that is ours alone (`own_folder`), and only when its bytes are those that were once compiled: the
hash of its content is part of its name. One rename makes it visible whole, whatever moment a process is killed at.

Nothing here raises for want of a compiler or a place: whatever goes wrong is logged and answered with None, and the
caller computes without it.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import logging
import platform
import shutil
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

from symcal.kernels.compiler import WITHOUT, Compiler, CompilerError, HungError, compile_c, find_compiler
from symcal.kernels.own_folder import kept_folder, private_folder, read_own_file
from symcal.outputs.whole_file import flush_path

logger = logging.getLogger(__name__)

# Never -ffast-math: it links start-up code that turns on flush-to-zero for the whole Python process.
FLAGS = ("-std=gnu11", "-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math", "-Wno-psabi", "-fno-sanitize=all")
NATIVE = ("-march=native", "-ffp-contract=fast")
# A product and a sum rounded one after the other, everywhere alike; no use of what only some processors have.
PORTABLE = ("-ffp-contract=off",)

_LONGEST = 64 * 2**20  # bytes of a library; the longest kernel that is compiled has some 1.5 MB
_SUFFIX = ".dll" if sys.platform == "win32" else ".so"
_SCRATCH = "build"
_ABANDONED_S = 3600.0  # after which the scratch folder of a killed process is swept: no compilation takes so long


@cache
def processor() -> str:
    """What -march=native may depend on: a home directory can be shared by machines that differ."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    wanted = ("model name", "flags", "features", "cpu family", "model", "cpu part", "isa")
    first = text.split("\n\n", 1)[0].splitlines()
    return "\n".join(line for line in first if line.split(":")[0].strip().lower() in wanted)


def load_library(source: str, optimisation: str, entry: str, *, portable: bool = False) -> ctypes.CDLL | None:
    """Compile C source (or find it compiled) and load it.

    Args:
        source: C text; the whole of it, since its hash is the key of the cache.
        optimisation: `-O1` .. `-O3`. entry: the function that the library must have.
        portable: for any processor of this kind, with every operation rounded on its own; else for this one.
    Returns:
        the library, or None if there is no compiler or it failed (the log says how).
    """
    compiler = find_compiler()
    if compiler is None:
        logger.info("no C compiler that works (CC, cc, gcc, clang, ziglang)")
        return None
    flags = (optimisation, *FLAGS, *(compiler.portable + PORTABLE if portable else NATIVE))
    parts = [source, *flags, *compiler.command, compiler.version, processor(), platform.platform()]
    key = hashlib.sha256("\0".join(parts).encode(errors="surrogateescape")).hexdigest()[:32]
    for place in (kept_folder, private_folder):
        try:
            folder = place()
            if folder is None:
                continue
            library = _cached(folder, key, entry)
            return library if library is not None else _build(compiler, flags, source, folder, key, entry)
        except CompilerError as error:
            _warn_once(f"{error}; {WITHOUT}")
            return None
        except OSError as error:  # a cache that is full or read-only, or no place for temporary files
            logger.info("no kernels are kept in this folder: %s", error)
    _warn_once(f"there is no folder to compile in, neither a cache nor a temporary one; {WITHOUT}")
    return None


@cache
def _warn_once(text: str) -> None:
    logger.warning(text)


def _cached(folder: Path, key: str, entry: str) -> ctypes.CDLL | None:
    """The library of a key, if it is whole; what is broken is removed."""
    for path in folder.glob(f"{key}-*{_SUFFIX}"):
        try:
            content = read_own_file(path, _LONGEST)
            if hashlib.sha256(content).hexdigest() != path.stem.partition("-")[2]:
                raise OSError(f"{path} is not what was compiled")
            return _loaded(path, entry)
        except OSError as error:
            logger.info("compiled again: %s", error)
            _remove(path)
    return None


def _loaded(path: Path, entry: str) -> ctypes.CDLL:
    """A library with the function wanted.

    Raises:
        OSError: it does not load, or has no such function.
    """
    library = ctypes.CDLL(str(path))
    try:
        library[entry]
    except AttributeError:
        raise OSError(f"{path} has no function {entry}") from None
    return library


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _build(compiler: Compiler, flags: tuple[str, ...], source: str, folder: Path, key: str, entry: str) -> ctypes.CDLL:
    """Compile in the cache's own folder and rename: another process sees the whole file or none.

    Raises:
        CompilerError: the compiler failed, hung, wrote nothing or something that does not load. OSError: the folder
        cannot be written.
    """
    _sweep(folder)
    with tempfile.TemporaryDirectory(prefix=_SCRATCH, dir=folder, ignore_cleanup_errors=True) as scratch:
        text, built = Path(scratch) / "kernel.c", Path(scratch) / f"kernel{_SUFFIX}"
        text.write_text(source, encoding="utf-8")
        arguments = [*flags, "-o", str(built), str(text), "-lm"]
        own = {"TMPDIR": scratch}  # the compiler's own temporary files: the user's TMPDIR may be full
        try:
            compile_c(compiler, arguments, own)
        except HungError:
            raise
        except CompilerError as error:  # some compilers know no -march=native
            if NATIVE[0] not in arguments:
                raise
            logger.info("%s", error)
            compile_c(compiler, [each for each in arguments if each != NATIVE[0]], own)
        try:
            content = read_own_file(built, _LONGEST)
        except FileNotFoundError:
            raise CompilerError(f"the C compiler {compiler.command[0]} wrote nothing") from None
        path = folder / f"{key}-{hashlib.sha256(content).hexdigest()}{_SUFFIX}"
        flush_path(built)  # so that a power cut costs nothing; the hash is what is relied on
        built.replace(path)
    flush_path(folder)
    try:
        return _loaded(path, entry)
    except OSError as error:
        _remove(path)
        raise CompilerError(f"what the C compiler {compiler.command[0]} wrote does not load: {error}") from None


def compiling_fault(compiler: Compiler) -> str | None:
    """What goes wrong when a line of C is compiled and loaded where kernels are; None: nothing. Nothing is kept.

    A compiler may answer and have no headers, no linker, or a folder whose files must not be run.
    """
    try:
        with tempfile.TemporaryDirectory(
            prefix=_SCRATCH, dir=kept_folder() or private_folder(), ignore_cleanup_errors=True
        ) as scratch:
            _build(compiler, ("-O1", *FLAGS, *NATIVE), _LINE, Path(scratch), "trial", "symcal_trial")
    except OSError as error:
        return " ".join(str(error).split())
    return None


_LINE = """#include <math.h>
double symcal_trial(double x) { return sin(x); }
"""


def _sweep(folder: Path) -> None:
    """Remove what killed processes left while compiling."""
    for left in folder.glob(f"{_SCRATCH}*"):
        with contextlib.suppress(OSError):
            if time.time() - left.lstat().st_mtime > _ABANDONED_S:
                _remove(left)
