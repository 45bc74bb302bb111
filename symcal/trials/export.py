"""The table of all trials, one row each by its number: the same bytes whatever order they were computed in."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from symcal.trials.description import Description
from symcal.trials.judge import COLUMNS
from symcal.trials.machine import Machine
from symcal.trials.store import Store

_LENGTHS = (
    *("before_rms", "mean", "rms", "p95", "max", "foretold_rms", "found_rms"),
    *("measured_mean", "measured_rms", "measured_p95", "measured_max"),
)
_CHUNK = 100_000  # rows that are held at once


def header(description: Description) -> list[str]:
    """Columns: the trial, its cell, the cell's values, then the numbers with their unit."""
    numbers = [f"{name}_mm" if name in _LENGTHS else name for name in list(COLUMNS)[2:]]
    return ["trial", "cell", *description.cells[0].shown, *numbers]


def rows(description: Description, store: Store) -> Iterator[Sequence[Any]]:
    shown = [tuple(cell.shown.values()) for cell in description.cells]
    for trial, cell, *numbers in store.rows():
        yield (trial, cell, *shown[cell], *numbers)


def write_csv(path: Path, description: Description, store: Store) -> None:
    """Numbers as Python writes them, which reads back to the same bits; empty where there is none."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header(description))
        writer.writerows(rows(description, store))


def write_parquet(path: Path, description: Description, store: Store, machine: Machine) -> None:
    """The same table with its types, and what it was computed with in its metadata; needs pyarrow."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = header(description)
    first, second, *own = COLUMNS.values()
    kinds = [first, second, *(type(value) for value in description.cells[0].shown.values()), *own]
    types = {int: pa.int64(), float: pa.float64(), str: pa.string()}
    fields = [(name, types[kind]) for name, kind in zip(names, kinds, strict=True)]
    schema = pa.schema(fields, metadata={f"symcal.{key}": value for key, value in machine.facts().items()})
    found = rows(description, store)
    with pq.ParquetWriter(path, schema) as writer:
        while chunk := list(islice(found, _CHUNK)):
            columns = [
                pa.array(column, type=field.type)
                for column, field in zip(zip(*chunk, strict=True), schema, strict=True)
            ]
            writer.write_table(pa.Table.from_arrays(columns, schema=schema))
