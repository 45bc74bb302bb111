"""Whether who made a left-over still lives: a lock that the system takes back from the dead.

A process holds an exclusive `flock` on what it has not finished. It ends with the process, however that ends, so that
no number of a process is ever mistaken for that of another one. Where there are no such locks (Windows, some network
file systems) nobody is known to be dead, and left-overs stay.
"""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

if sys.platform != "win32":
    import fcntl


def try_lock(descriptor: int) -> bool | None:
    """Take the lock of an open file; False where another process has it, None where there are no locks."""
    if sys.platform == "win32":
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def is_free(path: Path) -> int | None:
    """The descriptor of a file whose maker is dead, locked; None where it lives, or the file is gone.

    Whoever gets it closes it, after the left-overs were removed.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        return None
    if try_lock(descriptor) and same_file(descriptor, path):
        return descriptor
    os.close(descriptor)
    return None


def same_file(descriptor: int, path: Path) -> bool:
    """Whether the open file still has this name."""
    with contextlib.suppress(OSError):
        return os.path.samestat(os.fstat(descriptor), path.lstat())
    return False
