"""A run's folder: whole or as it was, and replaced only where a run made everything in it."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from symcal.errors import InputError, RefusedError
from symcal.outputs.csv_text import Rows, csv_text
from symcal.outputs.manifest import MANIFEST, foreign_files, has_manifest, write_manifest
from symcal.outputs.whole_file import write_whole
from symcal.outputs.whole_folder import absolute, recover, whole_folder

CODE = "c"
"""Where the C code is in a run's folder."""

_NAMED = 3  # files in a message


def require_replaceable(target: Path, inputs: Iterable[Path] = (), own: Collection[str] = ()) -> None:
    """Refuse early, before the work is done, what `run_folder` would not replace.

    What killed runs left beside the target is mended before what is in it is looked at.

    Args:
        inputs: files and folders that the run reads. own: names of files in the folder that are the run's working
            state, and are carried over by it.
    Raises:
        RefusedError: the target is a file, a link or where a file system is mounted, holds an input, or holds a file
            that no run made or that was changed since: by its manifest.json. A folder without one (of an earlier
            version, or somebody's) is refused unless it is empty. What `make` made in its C code does not count.
        InputError: the target cannot be read.
    """
    _require_possible(target, inputs)
    recover(target)
    _refuse_foreign(absolute(target), target, own)


def _require_possible(target: Path, inputs: Iterable[Path]) -> None:
    """Refuse what can be no run's folder, whatever is in it, or holds what the run reads."""
    where = absolute(target)
    if _is_folder(where) is False:
        raise RefusedError(f"{target} is not a folder: nothing was written; choose another --out")
    if os.path.ismount(where):
        raise RefusedError(
            f"{target} is where a file system is mounted, which cannot change places with a new folder: choose a "
            f"folder in it, such as {target / 'run'}"
        )
    for folder in (where, *where.parents):
        found = _is_folder(folder)
        if found is False:
            raise InputError("the output folder cannot be used: Not a directory", file=target)
        if found and not _writable(folder):
            raise InputError("the output folder cannot be written: Permission denied", file=target)
        if found and folder != where:
            break
    for path in inputs:
        if any(own.is_relative_to(where) for own in (path.absolute(), path.resolve())):
            raise RefusedError(
                f"{path} is read by this run and lies in {target}: it would be lost; choose another --out"
            )


@contextmanager
def run_folder(target: Path, inputs: Iterable[Path] = (), own: Collection[str] = ()) -> Iterator[Path]:
    """A fresh folder to write into; it becomes ``target`` when the block ends well, and vanishes when it does not.

    Its manifest.json lists what was written. See `symcal.outputs.whole_folder`.

    Args:
        inputs, own: as of `require_replaceable`.

    Raises:
        RefusedError, InputError: as `require_replaceable`; the folder cannot be written.
    """
    _require_possible(target, inputs)
    with whole_folder(target, lambda folder: _refuse_foreign(folder, target, own), write_manifest) as folder:
        yield folder


def _is_folder(path: Path) -> bool | None:
    """None where nothing is; a link is none. Asked once: other runs may take a folder away and put another there."""
    try:
        return stat.S_ISDIR(path.lstat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return None


def _writable(folder: Path) -> bool:
    """Whether a folder may be written, or is not there for a moment."""
    may = os.W_OK | os.X_OK
    return os.access(folder, may) or not _is_folder(folder) or os.access(folder, may)


def _refuse_foreign(folder: Path, shown: Path, own: Collection[str] = ()) -> None:
    """Refuse what no run made, or what was changed since; an empty folder is nobody's."""
    if _is_folder(folder) is False:
        raise RefusedError(f"{shown} is not a folder: nothing was written; choose another --out")

    def made_since(name: str) -> bool:
        return name in own or (name.startswith(f"{CODE}/") and _made_from_code(name))

    try:
        foreign = foreign_files(folder, made_since=made_since)
        known = not foreign or has_manifest(folder)
    except OSError as error:
        raise InputError(f"the output folder cannot be used: {error.strerror}", file=shown) from None
    if not foreign:
        return
    names = ", ".join(foreign[:_NAMED]) + (", ..." if len(foreign) > _NAMED else "")
    if known:
        why = "that no run made or that were changed since"
        raise RefusedError(f"{shown} holds files {why} ({names}): it is not replaced; choose another --out")
    raise RefusedError(
        f"{shown} holds files and no {MANIFEST} that says a run made them ({names}): it is not replaced; choose "
        "another --out, or remove the folder if a version before these manifests made it"
    )


def _made_from_code(path: str) -> bool:
    """Whether `make` in a run's folder of C code made a file."""
    from symcal.export.c import is_built

    folder, _, name = path.partition("/")
    return folder == CODE and is_built(name)


def write_table(path: Path, rows: Rows, columns: Iterable[str] | None = None) -> None:
    """Write a table as CSV; see `symcal.outputs.csv_text`.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, csv_text(rows, columns))


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write JSON without NaN or infinity, which JSON does not have.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
