"""A folder that is whole or as it was: made beside its place, flushed to the disk, and exchanged for the old one.

Beside a target `name` stand, while it is made, hidden siblings (`*` are twelve hexadecimal digits):

    .name-*.lock    held by the process that makes it, see `symcal.outputs.locks`; first to come, last to go
    .name-*         what is made; after the exchange the old folder, until it is removed
    .name-*.old     the old folder, only where folders cannot be exchanged in one step

The next process with the same target removes what the dead left, and puts the old folder back if there is none.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from symcal.errors import InputError, RefusedError
from symcal.outputs.exchange import exchange
from symcal.outputs.locks import is_free, same_file, try_lock
from symcal.outputs.whole_file import flush, flush_path

_OCCUPIED = frozenset({errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR})
_OVERTAKEN = _OCCUPIED | {errno.ENOENT}  # the old folder went, and another may stand there again
_KEPT_OF_NAME = 200  # bytes of a name in that of its hidden siblings; a longer one is hashed
_TRIES = 1000  # others that were faster, before this is called an error

Check = Callable[[Path], None]


@contextmanager
def whole_folder(target: Path, check: Check, seal: Check = lambda _: None) -> Iterator[Path]:
    """A fresh folder beside ``target``, which it becomes when the block ends well; it vanishes when it does not.

    It has the permissions that the user's umask gives. Processes with one target do not disturb each other: the last
    one to end stands there.

    Args:
        check: raises where the folder it is given may not be replaced. Asked of the target before the block, at its
            end, and of the old folder before it is removed: what came into it meanwhile is kept, in its place, and the
            new folder gets the first free name `<target>-1`, `-2`, ...
        seal: what is done with the fresh folder at the end.
    Raises:
        RefusedError: the target may not be replaced. InputError: it cannot be written; the old one is untouched.
    """
    target = absolute(target)
    recover(target)
    check(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        stage = _stage(target)
    except OSError as error:
        raise InputError(f"the output folder cannot be written: {error.strerror}", file=target) from None
    try:
        yield stage.fresh
        seal(stage.fresh)
        _flush_tree(stage.fresh)
        try:
            _place(stage, target, check)
        except RefusedError as error:
            raise RefusedError(f"{error}; the result is in {_beside(stage.fresh, target)}") from None
        except OSError as error:  # such as a folder of a lower layer of an overlay, which cannot be renamed
            message = f"the old folder cannot be replaced: {error.strerror}; it is untouched, and the result is in "
            raise InputError(message + str(_beside(stage.fresh, target)), file=target) from None
        flush_path(target.parent)
    except InputError as error:
        if error.file is not None and error.file.is_relative_to(stage.fresh):
            error.file = target / error.file.relative_to(stage.fresh)
        raise
    except OSError as error:
        message = f"the output folder cannot be written: {error.strerror or error}; what was there before is untouched"
        raise InputError(message, file=target) from error
    finally:
        stage.clear()


def absolute(target: Path) -> Path:
    """A folder's path with links and `..` before its name resolved.

    Raises:
        InputError: it cannot be a path, or is the root.
    """
    try:
        whole = target.resolve() if target.name in ("", "..") else target.parent.resolve() / target.name
        if not whole.name:
            raise InputError("this folder cannot be replaced", key="--out", found=target)
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            whole.lstat()
    except (OSError, RuntimeError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"this cannot be a folder: {reason}", key="--out", found=target) from None
    return whole


def recover(target: Path) -> None:
    """Undo what killed processes left half done: put the old folder back if there is none, remove what they made."""
    target = absolute(target)
    lock = re.compile(re.escape(_prefix(target)) + r"[0-9a-f]{12}\.lock")
    with contextlib.suppress(OSError):
        for name in os.listdir(target.parent):  # noqa: PTH208
            if not lock.fullmatch(name):
                continue
            descriptor = is_free(target.parent / name)
            if descriptor is None:
                continue
            stage = _Stage(target.parent / name, descriptor)
            if stage.old.is_dir() and not os.path.lexists(target):
                with contextlib.suppress(OSError):
                    stage.old.rename(target)
            stage.clear()


@dataclass(frozen=True, slots=True)
class _Stage:
    """The hidden siblings of a target, by their lock; descriptor: of the lock, held."""

    lock: Path
    descriptor: int

    @property
    def fresh(self) -> Path:
        return self.lock.with_suffix("")

    @property
    def old(self) -> Path:
        return self.lock.with_suffix(".old")

    def clear(self) -> None:
        """Remove them; the lock last, and only if nothing else is left."""
        for path in (self.fresh, self.old):
            shutil.rmtree(path, ignore_errors=True)
        with contextlib.suppress(OSError):
            if not self.fresh.exists() and not self.old.exists():
                self.lock.unlink()
        os.close(self.descriptor)


def _stage(target: Path) -> _Stage:
    for _ in range(_TRIES):
        lock = target.parent / f"{_prefix(target)}{secrets.token_hex(6)}.lock"
        descriptor = os.open(lock, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
        if try_lock(descriptor) is False or not same_file(descriptor, lock):  # taken for dead before it was locked
            os.close(descriptor)
            continue
        stage = _Stage(lock, descriptor)
        try:
            stage.fresh.mkdir()
        except BaseException:
            stage.clear()
            raise
        return stage
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))


def _prefix(target: Path) -> str:
    name = os.fsencode(target.name)
    return f".{target.name if len(name) <= _KEPT_OF_NAME else hashlib.sha256(name).hexdigest()}-"


def _place(stage: _Stage, target: Path, check: Check) -> None:
    """Give the fresh folder its name, where nothing is or in exchange for what may be replaced."""
    for _ in range(_TRIES):
        try:
            if not os.path.lexists(target):
                stage.fresh.rename(target)
                return
            check(target)
            aside = stage.fresh if exchange(stage.fresh, target) else _rename_twice(stage, target)
        except OSError as error:
            faster = error.errno in _OVERTAKEN or not os.path.lexists(target)
            if faster and stage.fresh.exists():  # another process put its folder there, or took the old one away
                shutil.rmtree(stage.old, ignore_errors=True)
                continue
            raise
        try:
            check(aside)
        except BaseException:
            _put_back(stage, aside, target)
            raise
        return
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))


def _rename_twice(stage: _Stage, target: Path) -> Path:
    """For file systems that cannot exchange: a kill between the two steps leaves no target; `recover` mends it."""
    try:
        target.rename(stage.old)
        stage.fresh.rename(target)
    except BaseException:  # also after an interrupt between the two
        if stage.old.exists() and not os.path.lexists(target):
            with contextlib.suppress(OSError):  # another process put its folder there meanwhile
                stage.old.rename(target)
        raise
    return stage.old


def _put_back(stage: _Stage, aside: Path, target: Path) -> None:
    """Undo `_place`: the old folder in its place, the new one in `stage.fresh`."""
    if aside == stage.fresh:
        exchange(aside, target)
        return
    target.rename(stage.fresh)
    aside.rename(target)


def _beside(fresh: Path, target: Path) -> Path:
    """Give the fresh folder the first free name beside the target."""
    for i in range(1, _TRIES):
        other = target.with_name(f"{target.name}-{i}")
        if os.path.lexists(other):
            continue
        try:
            fresh.rename(other)
        except OSError as error:
            if error.errno in _OCCUPIED:
                continue
            raise
        return other
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))


def _flush_tree(folder: Path) -> None:
    """Bring a folder and all in it to the disk.

    Raises:
        OSError: the disk is full or broken.
    """
    for root, _, files in os.walk(folder):
        for name in files:
            descriptor = os.open(Path(root) / name, os.O_RDONLY)
            try:
                flush(descriptor)
            finally:
                os.close(descriptor)
        flush_path(Path(root))
