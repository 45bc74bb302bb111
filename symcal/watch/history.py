"""The history of checks: a CSV file with a row for each, and nothing else.

A check of the same data by the same calibration, in the same way, takes the place of its row. Processes that add to one
file wait for each other.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from symcal.documents.csv_file import read_table
from symcal.documents.read import TABLE_LIMIT, read_text
from symcal.errors import InputError, RefusedError
from symcal.outputs.csv_text import csv_text
from symcal.outputs.locks import try_lock
from symcal.outputs.whole_file import write_whole

Row = dict[str, Any]

_FIRST = ("date", "verdict", "what", "p", "poses", "moved", "alpha", "gross", "calibration", "data", "digest")
_SAME = ("calibration", "digest", "moved", "alpha")
_PATIENCE = 30.0  # s, for another check to add its row


def row(content: Mapping[str, Any], date: str, calibration: str, data: str, digest: str) -> Row:
    """The row of a check. Tests over their limits are columns `<what>_over_limit`: alarm is above 1. Offsets of joints
    are `<joint>_mrad` (or `_mm`), their limits `<joint>_limit_mrad`: empty where a joint is not seen."""
    out: Row = {
        "date": date,
        "verdict": content["verdict"],
        "what": " or ".join(each["name"] for each in content["group"])
        or ("" if content["verdict"] == "holds" else "no one change"),
        "p": content["p"],
        "poses": len(content["poses"]),
        "moved": "yes" if content["moved"] else "no",
        "alpha": content["alpha"],
        "gross": content["gross"],
        "calibration": calibration[:12],
        "data": data,
        "digest": digest[:12],
    }
    for name, test in content["tests"].items():
        out[f"{name}_over_limit"] = None if test["limit"] is None else test["squares"] / test["limit"]
    for name, joint in content["joints"].items():
        if joint is not None:
            unit, factor = ("mrad", 1e3) if joint["unit"] == "rad" else ("mm", 1.0)
            out[f"{name}_{unit}"], out[f"{name}_limit_{unit}"] = joint["offset"] * factor, joint["limit"] * factor
    return out


def with_row(path: Path, new: Row) -> list[Row]:
    """Add a row to a history, and give all of it, oldest first.

    Raises:
        InputError: the file is no history, or cannot be written. RefusedError: another check does not let go of it.
    """
    with _alone(path):
        rows = read_history(path) if path.exists() else []
        kept = [each for each in rows if any(str(each.get(key, "")) != _text(new[key]) for key in _SAME)]
        kept = sorted([*kept, {key: _text(value) for key, value in new.items()}], key=lambda each: str(each["date"]))
        columns = [*_FIRST, *dict.fromkeys(key for each in kept for key in each if key not in _FIRST)]
        write_whole(path, csv_text(kept, columns))
    return kept


def read_history(path: Path) -> list[Row]:
    """The rows of a history as they were written, by column.

    Raises:
        InputError: it is none.
    """
    if not read_text(path, TABLE_LIMIT).strip():
        return []
    table = read_table(path)
    missing = [name for name in _FIRST if name not in table.columns]
    if missing:
        message = "this is no history of checks: it was not written by 'symcal watch'"
        raise InputError(message, file=path, line=table.head_line, column=missing[0], allowed=table.columns)
    columns = {name: table.text(name) for name in table.columns}
    return [{name: cells[i] for name, cells in columns.items()} for i in range(len(table))]


def _text(value: Any) -> str:
    """A cell as it is read back."""
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Hold the history: `.<name>.lock` beside it stays, empty."""
    lock = path.with_name(f".{path.name}.lock")
    try:
        descriptor = os.open(lock, os.O_CREAT | os.O_RDWR, 0o666)
    except OSError as error:
        raise InputError(f"the history cannot be written: {error.strerror}", file=path, key="--history") from None
    try:
        end = time.monotonic() + _PATIENCE
        while try_lock(descriptor) is False:
            if time.monotonic() > end:
                raise RefusedError(f"another check holds {path}: its row was not added")
            time.sleep(0.05)
        yield
    finally:
        os.close(descriptor)


def numbers(rows: list[Row], column: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """A column as numbers, NaN where it is empty or none, shape (rows,)."""
    out = []
    for each in rows:
        try:
            out.append(float(each.get(column) or "nan"))
        except ValueError:
            out.append(np.nan)
    return np.array(out)
