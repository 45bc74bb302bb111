"""A run's folder.

Written beside its place and moved there when whole, so that an interrupted run leaves the old one untouched.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from symcal.errors import InputError, RefusedError

CONTENT = frozenset(
    {
        "results.json",
        "report.pdf",
        "figures",
        "tables",
        "calibrated.yaml",
        "plan.csv",
        "measurements.csv",
        "measurements",
        "experiment.resolved.yaml",
        "c",
        "images",
        "camera.yaml",
    }
)
"""Names that a run's folder may hold. A folder with anything else is not replaced: it is somebody's."""


def require_place(file: Path) -> None:
    """Refuse early, before the work is done, a file that could not be written.

    Raises:
        InputError: its folder is not there, or the name is a folder's.
    """
    if file.is_dir():
        raise InputError("this is a folder: name a file", key="--out", found=file)
    if not file.absolute().parent.is_dir():
        raise InputError("the folder of this file is not there: make it first", key="--out", found=file)


def require_replaceable(target: Path) -> None:
    """Refuse early, before the work is done, what `run_folder` would not replace.

    Raises:
        RefusedError: the target is a file, a link, or a folder that holds more than a run's output.
        InputError: the target cannot be read.
    """
    target = target.absolute()
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise RefusedError(f"{target} is not a folder: nothing was written; choose another --out")
    try:
        strangers = sorted({p.name for p in target.iterdir()} - CONTENT) if target.is_dir() else []
    except OSError as error:
        raise InputError(f"the output folder cannot be read: {error.strerror}", file=target) from None
    if strangers:
        shown = ", ".join(strangers[:3]) + (", ..." if len(strangers) > 3 else "")
        raise RefusedError(
            f"{target} holds files that no run writes ({shown}): it is not replaced; choose another --out"
        )


@contextmanager
def run_folder(target: Path) -> Iterator[Path]:
    """A fresh folder to write into; it becomes ``target`` when the block ends well, and vanishes when it does not.

    Raises:
        RefusedError: the target is a file, or a folder that holds more than a run's output.
        InputError: the folder cannot be written.
    """
    require_replaceable(target)
    target = target.absolute()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise InputError(f"the output folder cannot be written: {error.strerror}", file=target) from None
    try:
        yield fresh
        fresh.chmod(0o755)
        _swap(fresh, target)
    except OSError as error:
        message = f"the output folder cannot be written: {error.strerror or error}; what was there before is untouched"
        raise InputError(message, file=target) from error
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def _swap(fresh: Path, target: Path) -> None:
    if not target.exists():
        fresh.rename(target)
        return
    aside = Path(tempfile.mkdtemp(prefix=f".{target.name}-old-", dir=target.parent))
    old = aside / "old"
    try:
        target.rename(old)
        fresh.rename(target)
    finally:  # also after an interrupt between the two
        if old.exists() and not target.exists():
            old.rename(target)
        shutil.rmtree(aside, ignore_errors=True)


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write JSON without NaN or infinity, which JSON does not have."""
    text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + os.linesep, encoding="utf-8")
