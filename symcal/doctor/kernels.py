"""What computes: compiler, kernels, the cache of those that are compiled, processors and threads."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_info

from symcal.doctor.finding import Finding
from symcal.errors import InputError
from symcal.kernels.compile import compiling_fault
from symcal.kernels.compiler import Compiler, find_compiler
from symcal.kernels.own_folder import cache_folder, open_own_folder
from symcal.kernels.path import SLOWER, VARIABLE, path_in_use
from symcal.outputs.side_by_side import cores
from symcal.words import plural

_GET_ONE = "install gcc or clang, or pip install 'symcal[fast]'"
_MB = 1e6


def kernel_findings() -> list[Finding]:
    """The compiler, tried on a line of C, and what numbers are made on."""
    compiler = find_compiler()
    fault = None if compiler is None else compiling_fault(compiler)
    return [_compiler(compiler, fault), _path(fault)]


def _compiler(compiler: Compiler | None, fault: str | None) -> Finding:
    if compiler is None:
        asked = os.environ.get("CC")
        if asked:
            return Finding("compiler", "note", f"CC={asked} does not work", "unset CC, or name one that works")
        return Finding("compiler", "note", "none (looked for cc, gcc, clang, ziglang)", _GET_ONE)
    if fault is not None:
        return Finding("compiler", "note", f"{compiler.name} does not compile: {fault}", _GET_ONE)
    return Finding("compiler", "ok", f"{compiler.name} ({compiler.command[0]})")


def _path(fault: str | None) -> Finding:
    """Which of the paths a job with many evaluations takes, and what it costs."""
    try:
        path = path_in_use()
    except InputError as error:
        return Finding("kernels", "broken", str(error), f"unset {VARIABLE}")
    if path.backend == "c" and fault is None:
        return Finding("kernels", "ok", f"{path}, the fastest path")
    said = "numpy, since nothing compiles" if path.backend == "c" else str(path)
    asked = os.environ.get(VARIABLE, "auto") not in ("auto", "portable")
    do = f"unset {VARIABLE}" if asked and path.backend != "c" else "see compiler"
    return Finding("kernels", "note", f"{said}: about {SLOWER} times slower than C", do)


def cache_finding() -> Finding:
    """Where compiled kernels are kept, how many bytes of them, and whether they can be."""
    folder = cache_folder()
    if folder is None:
        return Finding("cache", "note", "no place: kernels are compiled again each time", "set HOME or XDG_CACHE_HOME")
    try:
        open_own_folder(folder)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(f"{folder} cannot be written")
    except OSError as error:
        do = f"chmod 700 {folder}, or set XDG_CACHE_HOME to a folder of your own"
        return Finding("cache", "note", f"not used, kernels are compiled again each time: {error}", do)
    files = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
    rights = f"{folder.stat().st_mode & 0o777:o}"
    said = f"{folder}: {len(files)} files, {sum(files) / _MB:.1f} MB, writable (rights {rights})"
    return Finding("cache", "ok", said, f"may be emptied at any time: rm -r '{folder}'")


def processor_finding() -> Finding:
    """The processor, how many of its cores this process may use, and the threads of linear algebra."""
    try:
        name = path_in_use("numpy").processor
    except InputError:
        name = "unknown"
    own, whole = cores(), os.cpu_count() or 1
    allowed = f"{whole} cores" if own == whole else f"{own} of {whole} cores allowed"
    pools = [each for each in threadpool_info() if each["user_api"] == "blas"]
    threads = [_threads(each) for each in pools]
    said = "; ".join([f"{name}, {allowed}", *threads])
    many = [each for each in pools if each["num_threads"] > 1]
    do = "matrices here are small: unset OPENBLAS_NUM_THREADS is fastest, and the same bits everywhere" if many else ""
    return Finding("processor", "note" if many else "ok", said, do)


def _threads(pool: Mapping[str, Any]) -> str:
    of = Path(pool["filepath"]).parent.name.removesuffix(".libs")
    return f"{pool['internal_api']} {pool['version']} of {of} with {plural(pool['num_threads'], 'thread')}"
