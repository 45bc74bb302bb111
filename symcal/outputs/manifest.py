"""What was made here: names and hashes of a folder's files, and which files are not among them."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from symcal.outputs.whole_file import write_whole

MANIFEST = "manifest.json"
SCHEMA = "symcal/manifest/1"

ENOUGH = 100
"""Foreign files before the rest is not looked at."""

_JUNK = frozenset({".DS_Store", "Thumbs.db", "desktop.ini", ".directory"})
"""What file managers leave in every folder that is looked at, and make again."""


def write_manifest(folder: Path) -> None:
    """List every plain file of a folder, at any depth, with its SHA-256, in `MANIFEST`."""
    plain = [name for name in sorted(_files(folder)) if name != MANIFEST and _is_plain(folder / name)]
    files = {name: _digest(folder / name) for name in plain}
    write_whole(folder / MANIFEST, json.dumps({"schema": SCHEMA, "files": files}, indent=2, ensure_ascii=False) + "\n")


def foreign_files(
    folder: Path, manifest: str = MANIFEST, *, made_since: Callable[[str], bool] = lambda _: False
) -> list[str]:
    """Files of a folder that its manifest does not list, or that are not what it lists any more; relative, and not more
    than `ENOUGH`: a home folder has millions.

    Links and whatever is no plain file are foreign; a link is never followed. Left out is what file managers leave
    (`.DS_Store` and the like). Without a readable manifest every file is foreign. A folder that is replaced while it is
    looked at is looked at again.

    Args:
        manifest: the name of the manifest; a JSON file with `files`, a hash by name.
        made_since: whether a file was made from the others and goes with them.
    Raises:
        OSError: the folder cannot be read.
    """
    while True:
        before = _identity(folder)
        found = _foreign(folder, manifest, made_since)
        if not found or before == _identity(folder):
            return found


def has_manifest(folder: Path) -> bool:
    """Whether a folder says what was made there."""
    return _listed(folder / MANIFEST) is not None


def _foreign(folder: Path, manifest: str, made_since: Callable[[str], bool]) -> list[str]:
    listed = _listed(folder / manifest)
    found: list[str] = []
    for name in _files(folder):
        if len(found) == ENOUGH:
            break
        path = folder / name
        if name == manifest and listed is not None:
            continue
        try:
            plain = _is_plain(path)
            if plain and (path.name in _JUNK or made_since(name)):
                continue
            if not plain or listed is None or name not in listed or _digest(path) != listed[name]:
                found.append(name)
        except FileNotFoundError:  # it went while the folder was looked at
            continue
    return found


def _files(folder: Path) -> Iterator[str]:
    """Everything in a folder but folders, at any depth, first what is in it itself; links are not followed."""
    try:
        with os.scandir(folder) as entries:
            own = sorted((entry.name, entry.is_dir(follow_symlinks=False)) for entry in entries)
    except FileNotFoundError:  # it went while it was looked at
        return
    yield from (name for name, is_folder in own if not is_folder)
    for name, is_folder in own:
        if is_folder:
            yield from (f"{name}/{inside}" for inside in _files(folder / name))


def _listed(path: Path) -> Mapping[str, str] | None:
    """Hashes by name; None where there is no manifest that can be read."""
    try:
        if not _is_plain(path):
            return None
        files = json.loads(path.read_text(encoding="utf-8"))["files"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return files if isinstance(files, dict) else None


def _is_plain(path: Path) -> bool:
    return stat.S_ISREG(path.lstat().st_mode)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _identity(folder: Path) -> tuple[int, ...] | None:
    try:
        status = folder.lstat()
    except FileNotFoundError:
        return None
    return status.st_dev, status.st_ino, status.st_mtime_ns
