"""Work that is killed at any step it takes in the file system, or at any moment."""

from __future__ import annotations

import os
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from symcal.outputs import whole_folder as whole_folder_module

Work = Callable[[], object]

_CHANGES = ("os.rename", "os.mkdir", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.chmod", "os.truncate")
_STEPS = frozenset((*_CHANGES, "fcntl.flock", "os.scandir", "os.listdir"))
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC


def count_steps(work: Work, folder: Path) -> int:
    """How many steps a piece of work takes in the file system at or below a folder; it is done in a child."""
    read, write = os.pipe()

    def counted() -> None:
        steps = [0]
        _watch(folder, lambda: steps.__setitem__(0, steps[0] + 1))
        work()
        os.write(write, str(steps[0]).encode())

    assert _ended(forked(counted)) == 0
    os.close(write)
    with os.fdopen(read) as pipe:
        return int(pipe.read())


def kill_at(work: Work, step: int, folder: Path) -> bool:
    """Do the work in a child that is killed before its step (from 0); whether it got there."""

    def killed() -> None:
        left = [step]

        def one() -> None:
            left[0] -= 1
            if left[0] < 0:
                os.kill(os.getpid(), signal.SIGKILL)

        _watch(folder, one)
        work()

    status = _ended(forked(killed))
    assert status in (0, -signal.SIGKILL), f"the child ended with {status}"
    return status != 0


def kill_after(work: Work, seconds: float) -> bool:
    """Do the work in a child that is killed after a time; whether it was not done by then."""
    child = forked(work)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            assert os.waitstatus_to_exitcode(status) == 0
            return False
        time.sleep(0.0005)
    os.kill(child, signal.SIGKILL)
    return _ended(child) != 0


def together(works: list[Work]) -> list[int]:
    """Do pieces of work at the same time, each in a child; their exit codes."""
    return [_ended(child) for child in [forked(work) for work in works]]


def forked(work: Work) -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks in a process with threads
        child = os.fork()
    if child:
        return child
    code = 1
    try:
        work()
        code = 0
    except BaseException:  # noqa: BLE001  # whatever it is, the child must not go on as a second pytest
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _ended(child: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _watch(folder: Path, step: Callable[[], None]) -> None:
    """Call before each step at or below the folder; for the rest of the process."""
    root = os.fsencode(folder.resolve())

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            writing = flags & _WRITING if isinstance(flags, int) else 0
            if isinstance(path, (str, bytes, os.PathLike)) and writing and _inside(path):
                step()
        elif event in _STEPS and (event == "fcntl.flock" or _inside(arguments[0])):
            step()

    def _inside(path: object) -> bool:
        if isinstance(path, int):  # of an open folder: `shutil.rmtree`
            return True
        name = os.fsencode(path)  # type: ignore[arg-type]
        return name.startswith(root) or not name.startswith(b"/")

    sys.addaudithook(hook)
    for module, name in ((os, "write"), (os, "fsync"), (whole_folder_module, "exchange")):
        _before(module, name, step)


def _before(module: Any, name: str, step: Callable[[], None]) -> None:
    function = getattr(module, name)

    def called(*arguments: Any) -> Any:
        step()
        return function(*arguments)

    setattr(module, name, called)


def cannot_exchange(*_: object) -> bool:
    """In place of `exchange`: a file system that has no such call."""
    return False
