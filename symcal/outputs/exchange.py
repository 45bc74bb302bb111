"""Two folders that change places in one step of the file system, so that there is no moment without one."""

from __future__ import annotations

import ctypes
import errno
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

_AT_FDCWD = -100  # linux/fcntl.h: paths are relative to the current folder
_RENAME_EXCHANGE = 2  # linux/fs.h, of renameat2(2)
_RENAME_SWAP = 2  # sys/stdio.h of macOS, of renamex_np(2)

_UNABLE = frozenset({errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EPERM, errno.EXDEV})
"""What kernels, file systems (NFS, some overlays) and sandboxes say that do not know the call."""


def exchange(a: Path, b: Path) -> bool:
    """Let what has two names change places; False where the system or the file system cannot.

    Raises:
        FileNotFoundError: one of the two is not there. OSError: it is not allowed.
    """
    call = _call()
    if call is None or call(os.fsencode(a), os.fsencode(b)) == 0:
        return call is not None
    number = ctypes.get_errno()
    if number in _UNABLE:
        return False
    raise OSError(number, os.strerror(number), str(b))


@cache
def _call() -> Callable[[bytes, bytes], int] | None:
    """The system's function, returning 0 and setting errno; None where it has none."""
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "darwin":
            swap = library.renamex_np
            swap.argtypes = (ctypes.c_char_p, ctypes.c_char_p, ctypes.c_uint)
            return lambda a, b: int(swap(a, b, _RENAME_SWAP))
        rename = library.renameat2
    except (AttributeError, OSError, TypeError):  # another system, or an old library
        return None
    rename.argtypes = (ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_uint)
    return lambda a, b: int(rename(_AT_FDCWD, a, _AT_FDCWD, b, _RENAME_EXCHANGE))
