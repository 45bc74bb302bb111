"""A file that is whole or as it was: written beside its place, flushed to the disk, and given its name in one step."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import stat
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from symcal.errors import InputError, RefusedError
from symcal.outputs.locks import is_free, same_file, try_lock

STAGE = re.compile(r"\..*-[0-9a-f]{12}", re.DOTALL)
"""Hidden names of folders that are being made; a lock `<name>.lock` stands beside one. See `whole_folder`."""

_UNFLUSHABLE = frozenset({errno.EINVAL, errno.ENOTSUP, errno.EBADF})  # what some file systems answer to fsync
_READ = 1 << 26  # bytes in which a file's mark is looked for
_KEPT_OF_NAME = 64  # letters of a name in that of its temporary file: there must be room for the rest


def write_whole(path: Path | str, content: str | bytes) -> None:
    """Write a file, text as UTF-8, so that whoever looks sees all of it or what was there before.

    It is written under a hidden name in the same folder, flushed, and renamed; a link is followed, and what it points
    to replaced. The file keeps its permissions; a new one has those that the user's umask gives. What killed writers of
    the same file left is removed. In a folder that is being made, which nobody sees before it is whole and flushed, it
    is simply written.

    Raises:
        InputError: the file cannot be written: a full disk, no permission, a name too long, a folder, a device or a
            pipe. What was there before is untouched.
    """
    write_all_whole({Path(path): content})


def write_all_whole(contents: Mapping[Path, str | bytes]) -> None:
    """Write files that belong together, as `write_whole`: all are on the disk before the first takes its name.

    A process that is killed between two names leaves some new and some old, each whole.

    Raises:
        InputError: as `write_whole`; then no file was changed.
    """
    staged: list[_Staged] = []
    path = Path()
    try:
        for path, content in contents.items():
            data = content.encode("utf-8") if isinstance(content, str) else content
            if _in_stage(path):
                _write_plainly(path, data)
            else:
                staged.append(_stage(real_place(path), data))
        for one in staged:
            os.replace(one.temporary, one.place)  # noqa: PTH105
        for folder in {one.place.parent for one in staged}:
            flush_path(folder)
    except (OSError, ValueError) as error:
        raise InputError(_sentence(error), file=path) from None
    finally:
        for one in staged:
            with contextlib.suppress(OSError):
                one.temporary.unlink(missing_ok=True)
            os.close(one.descriptor)


def require_place(file: Path, inputs: Iterable[Path] = ()) -> None:
    """Refuse early, before the work is done, a file that could not be written, or that the work reads.

    Args:
        inputs: files that are read.
    Raises:
        InputError: its folder is not there, the name is a folder's, a device's or a pipe's, or the file is protected.
        RefusedError: it is one of the inputs.
    """
    try:
        place = real_place(file)
        if not place.parent.is_dir():
            raise InputError("the folder of this file is not there: make it first", key="--out", found=file)
        for path in inputs:
            if path.exists() and place.exists() and path.samefile(place):
                raise RefusedError(f"{file} is read by this command: it would be lost; choose another --out")
    except (OSError, ValueError) as error:
        raise InputError(_sentence(error), key="--out", found=file) from None


def place_of(out: Path | None, default: str, inputs: Iterable[Path] = ()) -> Path:
    """Where a command writes its file, as `require_place` has looked at it.

    Args:
        out: as the user named it; None: `default` in the current folder, if nothing of that name is there: somebody may
            have put it there who did not think of this command.
    Raises:
        InputError, RefusedError: as `require_place`. RefusedError: the default is there.
    """
    if out is None and os.path.lexists(default):
        raise RefusedError(f"{default} is there already and is kept: '--out {default}' replaces it, or name another")
    place = Path(default) if out is None else out
    require_place(place, inputs)
    return place


def require_own(path: Path, *marks: bytes) -> None:
    """Refuse to replace a file that the user did not name and that was not written by this program.

    Args:
        marks: one of them stands in every such file.
    Raises:
        RefusedError: there is another file of this name. InputError: it cannot be read.
    """
    place = real_place(path)
    if not os.path.lexists(place):
        return
    try:
        with place.open("rb") as file:
            content = file.read(_READ)
    except OSError as error:
        raise InputError(_sentence(error), file=path) from None
    if not any(mark in content for mark in marks):
        raise RefusedError(
            f"{path} is there already and was not written by this program: it is kept; choose another --out"
        )


def real_place(path: Path) -> Path:
    """Where a file is, links followed.

    Raises:
        InputError: it is a folder, a device, a pipe, a stream of a process, or protected from writing.
        OSError, ValueError: it cannot be looked at.
    """
    place, folder = Path(os.path.realpath(path)), Path(os.path.realpath(path.parent))
    if folder.is_relative_to("/proc") or (path.is_symlink() and path.readlink().is_relative_to("/proc")):
        raise InputError("this is a stream of a process: name a file", file=path)
    try:
        mode = place.stat().st_mode
    except FileNotFoundError:
        return place
    if stat.S_ISDIR(mode):
        raise InputError("this is a folder: name a file", file=path)
    if not stat.S_ISREG(mode):
        raise InputError("this is a device or a pipe: name a file", file=path)
    if not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    return place


def flush_path(path: Path) -> None:
    """Bring a file, or the names of a folder, to the disk, where the system can."""
    with contextlib.suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def flush(descriptor: int) -> None:
    """Bring an open file to the disk.

    Raises:
        OSError: the disk is full or broken; not where the file system knows no flushing.
    """
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _UNFLUSHABLE:
            raise


@dataclass(frozen=True, slots=True)
class _Staged:
    """A file on the disk that still has a hidden name; its descriptor holds the lock that says who made it lives."""

    place: Path
    temporary: Path
    descriptor: int


def _stage(place: Path, data: bytes) -> _Staged:
    _sweep(place)
    temporary, descriptor = _temporary(place)
    try:
        with contextlib.suppress(FileNotFoundError):
            os.chmod(temporary, stat.S_IMODE(place.stat().st_mode) & 0o777)  # noqa: PTH101
        _write(descriptor, data)
        flush(descriptor)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        os.close(descriptor)
        raise
    return _Staged(place, temporary, descriptor)


def _temporary(place: Path) -> tuple[Path, int]:
    """A new file beside a place, open and locked."""
    while True:
        path = place.with_name(f"{_prefix(place)}{secrets.token_hex(6)}.tmp")
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR | getattr(os, "O_BINARY", 0), 0o666)
        if try_lock(descriptor) is not False and same_file(descriptor, path):
            return path, descriptor
        os.close(descriptor)  # another writer took it for a dead one's before it was locked, and removes it


def _in_stage(path: Path) -> bool:
    return any(
        STAGE.fullmatch(folder.name) and folder.with_name(f"{folder.name}.lock").is_file() for folder in path.parents
    )


def _write_plainly(path: Path, data: bytes) -> None:
    descriptor = os.open(path, os.O_CREAT | os.O_TRUNC | os.O_WRONLY | getattr(os, "O_BINARY", 0), 0o666)
    try:
        _write(descriptor, data)
    finally:
        os.close(descriptor)


def _write(descriptor: int, data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def _prefix(place: Path) -> str:
    return f".{os.fsencode(place.name)[:_KEPT_OF_NAME].decode('utf-8', 'ignore')}-"


def _sweep(place: Path) -> None:
    """Remove what killed writers of this file left."""
    left = re.compile(re.escape(_prefix(place)) + r"[0-9a-f]{12}\.tmp")
    with contextlib.suppress(OSError):
        for name in os.listdir(place.parent):  # noqa: PTH208
            if not left.fullmatch(name):
                continue
            descriptor = is_free(place.parent / name)
            if descriptor is not None:
                with contextlib.suppress(OSError):
                    (place.parent / name).unlink()
                os.close(descriptor)


def _sentence(error: OSError | ValueError) -> str:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return f"the file cannot be written: {reason}"
