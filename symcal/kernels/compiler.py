"""The user's C compiler, or the one that `symcal[fast]` brings: found once, run with an end in sight.

A compiler is a foreign program: it may be missing, refuse, hang, start children, read its standard input or talk
without end. None of this stops the caller, who learns in one sentence what happened.
"""

from __future__ import annotations

import contextlib
import logging
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import IO

from symcal.kernels.own_folder import kept_folder, open_own_folder, private_folder

logger = logging.getLogger(__name__)

VERSION_TIMEOUT_S = 5.0
"""For `--version`, which takes gcc 2 ms and clang 20 ms; ours, with room for a network drive."""

COMPILE_TIMEOUT_S = 60.0
"""For one kernel: the longest that is compiled (20 000 instructions) takes gcc some 15 s. A compiler that took more is
not asked again."""

BUNDLED_TIMEOUT_S = 300.0
"""For the compiler that comes as a package: the first time it compiles what a C library needs (10 s of CPU time)."""

_KEPT = 64 * 1024  # bytes of output that are kept; the rest is read and dropped
_UNREAPED_S = 2.0  # a killed child is gone at once, unless the kernel holds it

# Commands that hung. A `symcal run` makes some ten kernels: each would wait again.
_hung: set[tuple[str, ...]] = set()


@dataclass(frozen=True, slots=True)
class Compiler:
    """A C compiler that answered: its command line and what it calls itself.

    bundled: whether it is Zig's, from the package `ziglang`.
    """

    command: tuple[str, ...]
    version: str
    bundled: bool = False

    @property
    def name(self) -> str:
        """The first line of what it calls itself."""
        first = next(iter(self.version.strip().splitlines()), "") or Path(self.command[0]).name
        return f"zig's {first.partition(' (')[0]}" if self.bundled else first

    @property
    def portable(self) -> tuple[str, ...]:
        """Flags for what every processor of this kind can run, whatever this one could do."""
        if platform.machine().lower() not in ("x86_64", "amd64"):
            return ()
        return ("-mcpu=baseline",) if self.bundled else ("-march=x86-64",)


class CompilerError(OSError):
    """The compiler did not do what was asked; the message is one sentence, or the compiler's own words."""


class HungError(CompilerError):
    """The compiler was still running after its time."""


def find_compiler() -> Compiler | None:
    """The C compiler of this machine.

    The CC variable if set (and then no other), else cc, gcc or clang on the PATH, else Zig's if the package `ziglang`
    is installed (`pip install symcal[fast]`).

    None, with a log entry, where there is none that works, or the one found has hung in this process.
    """
    found = _find_compiler(os.environ.get("CC", ""), os.environ.get("PATH", ""))
    return None if found is None or found.command in _hung else found


@cache
def _find_compiler(cc: str, path: str) -> Compiler | None:
    try:
        asked = shlex.split(cc)
    except ValueError as error:
        logger.warning("the CC variable cannot be read (%s): %s", str(error).lower(), WITHOUT)
        return None
    for command in [asked] if asked else [["cc"], ["gcc"], ["clang"]]:
        program = shutil.which(command[0], path=path)
        if program is None:
            continue
        full = (program, *command[1:])
        try:
            return Compiler(full, run([*full, "--version"], VERSION_TIMEOUT_S, keep="stdout"))
        except CompilerError as error:
            logger.info("%s", error)
    return None if asked else _bundled()


def _bundled() -> Compiler | None:
    """Zig's C compiler; its program itself, since `python -m ziglang` would look in the current folder first."""
    spec = find_spec("ziglang")
    if spec is None or spec.origin is None:
        return None
    program = Path(spec.origin).with_name("zig.exe" if sys.platform == "win32" else "zig")
    if not program.is_file():
        return None
    command = (str(program), "cc")
    try:
        return Compiler(command, run([*command, "--version"], VERSION_TIMEOUT_S, keep="stdout"), bundled=True)
    except CompilerError as error:
        logger.info("%s", error)
        return None


def _own_cache() -> dict[str, str]:
    """Where Zig keeps what it compiled of the C library, which becomes part of what we load: in a safe folder.

    Raises:
        OSError: there is no place, not even a temporary one.
    """
    place = (kept_folder() or private_folder()) / "zig"
    open_own_folder(place)
    place.chmod(0o700)  # Zig makes folders in it as the user's mask has it
    return {"ZIG_GLOBAL_CACHE_DIR": str(place), "ZIG_LOCAL_CACHE_DIR": str(place)}


WITHOUT = "kernels run without C"
"""What happens then, for messages."""


def compile_c(compiler: Compiler, arguments: Sequence[str], environment: Mapping[str, str] | None = None) -> None:
    """Run a compiler on files.

    Args:
        environment: variables that differ from this process's.
    Raises:
        CompilerError: it refused (the message is its own) or could not be started. HungError: it hung, now or before.
    """
    if compiler.command in _hung:
        raise HungError(f"{compiler.command[0]} has hung before")
    limit = BUNDLED_TIMEOUT_S if compiler.bundled else COMPILE_TIMEOUT_S
    own = {**_environment(compiler), **(environment or {})}
    try:
        run([*compiler.command, *arguments], limit, keep="stderr", environment=own)
    except HungError:
        _hung.add(compiler.command)
        message = f"{compiler.command[0]} did not finish in {limit:.0f} s and is not used again"
        raise HungError(message) from None


def output_of(compiler: Compiler, arguments: Sequence[str], timeout: float) -> str:
    """What a compiler writes to its standard output.

    Raises:
        CompilerError: as `run`.
    """
    return run([*compiler.command, *arguments], timeout, keep="stdout", environment=_environment(compiler))


def _environment(compiler: Compiler) -> dict[str, str]:
    try:
        return _own_cache() if compiler.bundled else {}
    except OSError as error:
        raise CompilerError(f"there is no folder for {compiler.command[0]} to work in: {error}") from None


def run(command: Sequence[str], timeout: float, *, keep: str, environment: Mapping[str, str] | None = None) -> str:
    """Run a program to its end, with nothing to read; its children die with it.

    Args:
        timeout: s. keep: `stdout` or `stderr`: which one is returned; the other is dropped.
        environment: variables that differ from this process's.
    Returns:
        the first 64 kB of what it wrote.
    Raises:
        CompilerError: it cannot be started or ends with another status than 0. HungError: it was still running, and
        was killed with all of its process group.
    """
    try:
        process = subprocess.Popen(
            list(command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if keep == "stdout" else subprocess.DEVNULL,
            stderr=subprocess.PIPE if keep == "stderr" else subprocess.DEVNULL,
            start_new_session=True,  # its own process group, which can be killed whole
            env=None if environment is None else {**os.environ, **environment},
        )
    except (OSError, ValueError) as error:
        raise CompilerError(f"{command[0]} cannot be started: {error}") from None
    said: list[bytes] = []
    pipe = process.stdout or process.stderr
    reader = threading.Thread(target=_drain, args=(pipe, said), daemon=True)
    reader.start()
    try:
        status = process.wait(timeout)
        reader.join(_UNREAPED_S)  # a child that it left behind may hold the pipe open
    except subprocess.TimeoutExpired:
        raise HungError(f"{command[0]} did not answer in {timeout:.0f} s") from None
    finally:
        _kill(process)  # also on an interrupt, which a session of its own does not see
    text = b"".join(said).decode(errors="replace")
    if status != 0:
        raise CompilerError(f"{command[0]} failed with {status}: {text[-2000:].strip()}")
    return text


def _drain(pipe: IO[bytes] | None, said: list[bytes]) -> None:
    """Read to the end and keep the beginning."""
    if pipe is None:
        return
    left = _KEPT
    with pipe, contextlib.suppress(OSError):
        while piece := os.read(pipe.fileno(), _KEPT):
            said.append(piece[:left])
            left -= len(said[-1])


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a program that still runs, with its children."""
    if process.poll() is not None:
        return
    if sys.platform == "win32":
        process.kill()
    else:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_UNREAPED_S)
