"""Folders for what will be run as code: used only where nobody but their owner can put anything in."""

from __future__ import annotations

import atexit
import logging
import os
import shutil
import stat
import sys
import tempfile
from functools import cache
from pathlib import Path

logger = logging.getLogger(__name__)


class UnsafeError(OSError):
    """A folder or file that cannot be trusted; the message says why."""


def cache_folder() -> Path | None:
    """Where compiled kernels are kept, absolute; safe to delete at any time. None where there is no place for it.

    An XDG_CACHE_HOME that is empty or relative is ignored, as its specification asks.
    Source: XDG Base Directory Specification 0.8.
    """
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if given.is_absolute():
        return given / "symcal" / "kernels"
    local = Path(os.environ.get("LOCALAPPDATA", ""))
    if sys.platform == "win32" and local.is_absolute():
        return local / "symcal" / "cache" / "kernels"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    if not home.is_absolute():
        return None
    return home / ("Library/Caches" if sys.platform == "darwin" else ".cache") / "symcal" / "kernels"


def kept_folder() -> Path | None:
    """The cache, made if need be and ours alone; None, said once in the log, where it cannot be used.

    Asked again for everything that is kept there, since a folder may change.
    """
    folder = cache_folder()
    if folder is None:
        return None
    try:
        open_own_folder(folder)
    except OSError as error:
        _inform_once(f"the cache of compiled kernels is not used: {error}")
        return None
    return folder


@cache
def _inform_once(text: str) -> None:
    logger.info(text)


def open_own_folder(folder: Path) -> None:
    """Make a folder, and be sure that nobody else can write in it, or put another in its place.

    It and its parent (`symcal/kernels`) must be real folders of this user that no group and nobody else may write in.
    What is above may be a link (a cache on another disk is common), but wherever it leads, every folder on the way
    belongs to this user or to root, and others cannot replace what is in it (no write permission, or a sticky bit).

    Raises:
        UnsafeError: somebody else could. OSError: it cannot be made.
    """
    folder.parent.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    for each in (folder.parent, folder):
        each.mkdir(exist_ok=True, mode=0o700)
        facts = each.lstat()
        if not stat.S_ISDIR(facts.st_mode):
            raise UnsafeError(f"{each} is not a folder itself but a link or a file")
        _insist_on_ours(each, facts)
    if sys.platform == "win32":
        return
    for above in folder.parent.parent.resolve(strict=True).parents:
        _insist_on_trusted(above)
    _insist_on_trusted(folder.parent.parent.resolve(strict=True))


def _insist_on_trusted(folder: Path) -> None:
    facts = folder.lstat()
    if facts.st_uid not in (0, _user()):
        raise UnsafeError(f"{folder} belongs to another user")
    if facts.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not facts.st_mode & stat.S_ISVTX:
        raise UnsafeError(f"others can write in {folder}")


def _insist_on_ours(path: Path, facts: os.stat_result) -> None:
    if sys.platform == "win32":  # a profile's folders are its user's
        return
    if facts.st_uid != _user():
        raise UnsafeError(f"{path} belongs to another user")
    if facts.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise UnsafeError(f"others can write in {path}")


def _user() -> int:
    return os.geteuid() if sys.platform != "win32" else 0


def read_own_file(path: Path, limit: int) -> bytes:
    """The bytes of an ordinary file of this user that nobody else can write; nothing else is opened for longer.

    Raises:
        FileNotFoundError: there is none. UnsafeError: a link, a pipe, a device, a file of another user or one that
        others can write, or more than ``limit`` bytes.
    """
    if not stat.S_ISREG(path.lstat().st_mode):
        raise UnsafeError(f"{path} is not an ordinary file")
    # The flags close the moment between looking and opening: no link is followed, no pipe waited for.
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as file:
        facts = os.fstat(file.fileno())
        if not stat.S_ISREG(facts.st_mode):
            raise UnsafeError(f"{path} is not an ordinary file")
        _insist_on_ours(path, facts)
        content = file.read(limit + 1)
    if len(content) > limit:
        raise UnsafeError(f"{path} is too long")
    return content


@cache
def private_folder() -> Path:
    """A temporary folder of this process alone, gone when it ends.

    Raises:
        OSError: there is no place for temporary files.
    """
    folder = Path(tempfile.mkdtemp(prefix="symcal-kernels"))  # made with mode 0700
    owner = os.getpid()

    def remove() -> None:
        if os.getpid() == owner:  # not a child that was forked later
            shutil.rmtree(folder, ignore_errors=True)

    atexit.register(remove)
    return folder
