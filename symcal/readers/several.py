"""Several files as one table: every row keeps its file, and poses of different files are different ones."""

from __future__ import annotations

import os
from array import array
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

from symcal.documents.read import TABLE_LIMIT, read_bytes
from symcal.documents.table import Origin, Table
from symcal.errors import InputError


def short_names(paths: Sequence[Path]) -> tuple[str, ...]:
    """What tells files apart: their path from the folder that all are in, without its end where it does not matter."""
    if len(paths) < 2:
        return tuple(path.stem for path in paths)
    folder = os.path.commonpath([path.parent for path in paths])
    whole = [Path(os.path.relpath(path, folder)) for path in paths]
    plain = [path.with_suffix("").as_posix() for path in whole]
    return tuple(plain if len(set(plain)) == len(plain) else [path.as_posix() for path in whole])


def insist_on_difference(paths: Sequence[Path]) -> None:
    """Refuse a file that is a copy of another.

    Raises:
        InputError: two files have the same content, and each of their poses would count twice.
    """
    from hashlib import sha256

    seen: dict[bytes, Path] = {}
    for path in paths:
        content = sha256(read_bytes(path, TABLE_LIMIT)).digest()
        if content in seen:
            message = f"this file is the same as {seen[content].name}, and each of its poses would count twice"
            raise InputError(message, file=path)
        seen[content] = path


def joined(tables: Sequence[Table], names: Sequence[str]) -> Table:
    """The rows of several tables, one after the other, with the columns of the first.

    Raises:
        InputError: a table has not the columns of the first, or another decimal sign.
    """
    first, *others = tables
    if not others:
        return first
    for table in others:
        for column in (*first.columns, *table.columns):
            if (column in first.columns) != (column in table.columns):
                here = "" if column in table.columns else " not"
                message = f"this column is{here} in {table.path.name}, and{' not' * (not here)} in {first.path.name}"
                raise table.error(message, column=column, allowed=first.columns)
        if table.decimal != first.decimal:
            message = f"{first.path.name} has another decimal sign ('{first.decimal}'): make them alike"
            raise table.error(message, found=table.decimal)
    order = [[table.columns.index(column) for column in first.columns] for table in tables]
    cells = tuple(
        tuple(chain.from_iterable(table.cells[own[k]] for table, own in zip(tables, order, strict=True)))
        for k in range(len(first.columns))
    )
    return Table(
        first.path,
        first.columns,
        cells,
        array("q", chain.from_iterable(table.lines for table in tables)),
        first.head_line,
        first.decimal,
        sum(table.hidden for table in tables),
        first.part,
        tuple(dict.fromkeys(chain.from_iterable(table.notes for table in tables))),
        tuple(Origin(table.path, name, table.part) for table, name in zip(tables, names, strict=True)),
        array("q", chain.from_iterable([i] * len(table) for i, table in enumerate(tables))),
    )
