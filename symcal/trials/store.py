"""The state of a study: one SQLite file in its folder, which any moment may interrupt.

    study   (key, value)            what the study is, and on what it runs, as JSON
    cells   (cell, shown)           what differs, as JSON
    trials  (trial, cell, status, reason, numbers ...)

One process writes, in write-ahead mode; a transaction is a few shards. A finished study's file is a copy in the
plain mode, so that looking into it changes no byte of it.
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError, RefusedError
from symcal.outputs.locks import same_file, try_lock
from symcal.trials.description import Cell
from symcal.trials.judge import COLUMNS, OK, Result

Array = NDArray[np.float64]

STATE = "study.sqlite"
LOCK = "study.lock"
_ORPHANS = 3.0  # seconds
SCHEMA = "symcal/study-state/1"
BESIDE = (STATE, f"{STATE}-wal", f"{STATE}-shm", f"{STATE}-journal", LOCK)
"""Names of the working state, as long as the study is not finished."""

_TYPES = {int: "INTEGER", float: "REAL", str: "TEXT"}
_MORE = {"trial": " PRIMARY KEY", "cell": " NOT NULL", "status": " NOT NULL"}
_NUMBERS = ", ".join(f"{name} {_TYPES[kind]}{_MORE.get(name, '')}" for name, kind in COLUMNS.items())
_TABLES = (
    "study (key TEXT PRIMARY KEY, value TEXT NOT NULL)",
    "cells (cell INTEGER PRIMARY KEY, shown TEXT NOT NULL)",
    f"trials ({_NUMBERS})",
)
_INSERT = f"INSERT OR REPLACE INTO trials VALUES ({', '.join('?' * len(COLUMNS))})"


class Store:
    """The open state of one study."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection

    def fact(self, key: str) -> Any:
        """What is known of the study under this name; None if nothing is."""
        row = self._connection.execute("SELECT value FROM study WHERE key = ?", (key,)).fetchone()
        return None if row is None else json.loads(row[0])

    def begin(self, facts: Mapping[str, Any], cells: Iterable[Cell]) -> None:
        """Keep what the study is, all or nothing.

        Raises:
            InputError: as of `add`.
        """
        with self._writing() as own:
            own.executemany("INSERT INTO study VALUES (?, ?)", [(k, json.dumps(v)) for k, v in facts.items()])
            own.executemany("INSERT INTO cells VALUES (?, ?)", [(c.number, json.dumps(c.shown)) for c in cells])

    def add(self, results: Iterable[Result]) -> None:
        """Keep results, all or none.

        Raises:
            InputError: the disk is full, or the file cannot be written.
        """
        with self._writing() as own:
            own.executemany(_INSERT, map(astuple, results))

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """A transaction."""
        try:
            with self._connection as own:
                yield own
        except sqlite3.Error as error:
            raise InputError(f"results cannot be kept: {error}", file=self.path) from None

    def count(self) -> int:
        return int(self._connection.execute("SELECT count(*) FROM trials").fetchone()[0])

    def gaps(self, total: int) -> list[tuple[int, int]]:
        """Runs of trials that are not there: the first, and the first one after."""
        gaps, expected = [], 0
        for (trial,) in self._connection.execute("SELECT trial FROM trials ORDER BY trial"):
            if trial > expected:
                gaps.append((expected, trial))
            expected = trial + 1
        return gaps if expected >= total else [*gaps, (expected, total)]

    def rows(self) -> Iterator[Sequence[Any]]:
        """Every trial by its number, as `COLUMNS`."""
        yield from self._connection.execute(f"SELECT {', '.join(COLUMNS)} FROM trials ORDER BY trial")

    def numbers(self, cell: int, *names: str) -> dict[str, Array]:
        """Columns of the trials of a cell that count, by trial; NaN where there is no number."""
        query = f"SELECT {', '.join(names)} FROM trials WHERE cell = ? AND status = ? ORDER BY trial"
        table = self._connection.execute(query, (cell, OK)).fetchall()
        values = np.array(table, dtype=np.float64).reshape(-1, len(names))
        return dict(zip(names, values.T, strict=True))

    def intervals(self, cell: int) -> NDArray[np.str_]:
        """Letters of the stated intervals of the trials of a cell that count, shape (R, n)."""
        query = "SELECT intervals FROM trials WHERE cell = ? AND status = ? ORDER BY trial"
        words = [row[0] for row in self._connection.execute(query, (cell, OK))]
        if not words:
            return np.empty((0, 0), dtype="U1")
        return np.array(words).view("U1").reshape(len(words), -1)

    def statuses(self, cell: int) -> dict[str, int]:
        """How many trials of a cell became what."""
        query = "SELECT status, count(*) FROM trials WHERE cell = ? GROUP BY status"
        return {status: int(count) for status, count in self._connection.execute(query, (cell,))}

    def reasons(self, cell: int) -> list[tuple[str, int]]:
        """Why trials of a cell do not count, the most frequent first."""
        query = (
            "SELECT reason, count(*) AS n FROM trials WHERE cell = ? AND status <> ? GROUP BY reason "
            "ORDER BY n DESC, reason"
        )
        return [(str(reason), int(count)) for reason, count in self._connection.execute(query, (cell, OK))]

    def copy(self, path: Path) -> None:
        """All of it as one new file in the plain mode, whoever looks into this one meanwhile.

        Raises:
            InputError: it cannot be written.
        """
        try:
            if self._connection.execute("PRAGMA journal_mode").fetchone()[0] == "wal":
                self._connection.execute("VACUUM INTO ?", (str(path),))
            else:  # of a finished study: as it is
                shutil.copyfile(self.path, path)
        except (OSError, sqlite3.Error) as error:
            raise InputError(f"the state of the study cannot be written: {error}", file=path) from None

    def close(self) -> None:
        self._connection.close()


@contextmanager
def opened(folder: Path) -> Iterator[Store]:
    """The state in a folder, which is made if it is not there; no other process may have it meanwhile.

    Raises:
        RefusedError: another process computes this study. InputError: the file cannot be used, or is none of ours.
    """
    path = folder / STATE
    descriptor = _locked(folder)
    try:
        connection = _connected(path)
        try:
            yield Store(path, connection)
        finally:
            connection.close()
    finally:
        if same_file(descriptor, folder / LOCK):  # in the folder of a finished study there is none, or somebody else's
            (folder / LOCK).unlink(missing_ok=True)
        os.close(descriptor)


def _locked(folder: Path) -> int:
    """The descriptor of the lock, held; the folder is made if it is not there.

    Workers of a process that was killed hold what it held until they notice, moments later.
    """
    until = time.monotonic() + _ORPHANS
    while True:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(folder / LOCK, os.O_CREAT | os.O_RDWR, 0o600)
        except OSError as error:
            raise InputError(f"the folder of the study cannot be used: {error.strerror}", file=folder) from None
        if try_lock(descriptor) is False:
            os.close(descriptor)
            if time.monotonic() < until:
                time.sleep(0.05)
                continue
            raise RefusedError(f"another process computes the study in {folder}: wait for it, or choose another --out")
        if same_file(descriptor, folder / LOCK):
            return descriptor
        os.close(descriptor)  # whoever had it has finished, and removed it


def _connected(path: Path) -> sqlite3.Connection:
    try:
        connection = sqlite3.connect(path, timeout=5.0, isolation_level="DEFERRED")
    except sqlite3.Error as error:
        raise InputError(f"the state of the study cannot be opened: {error}", file=path) from None
    try:
        tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not tables <= {"study", "cells", "trials"}:
            raise InputError("this is no state of a study: choose another --out", file=path)
        connection.execute("PRAGMA synchronous = NORMAL")
        if len(tables) < 3:  # of a finished study nothing may be changed
            connection.execute("PRAGMA journal_mode = WAL")
            for table in _TABLES:
                connection.execute(f"CREATE TABLE IF NOT EXISTS {table}")
            connection.commit()
    except sqlite3.Error as error:
        connection.close()
        raise InputError(f"the state of the study cannot be read ({error}): choose another --out", file=path) from None
    except BaseException:
        connection.close()
        raise
    return connection
