"""Small tables as CSV text: rows are mappings from column to cell."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

Rows = Sequence[Mapping[str, Any]]
"""A table: a mapping from column to cell for every row; a row may lack columns that others have."""


def csv_text(rows: Rows, columns: Iterable[str] | None = None) -> str:
    """A table as CSV; what is not there, None and NaN are empty cells, and numbers are written out to their last bit.

    Args:
        columns: their order; as they first appear in the rows when None.
    """
    heads = list(dict.fromkeys(name for row in rows for name in row)) if columns is None else list(columns)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows([_cell(row.get(name)) for name in heads] for row in rows)
    return text.getvalue()


def rows_of(columns: Mapping[str, Iterable[Any]]) -> list[dict[str, Any]]:
    """The rows of a table that is given by columns of equal length."""
    return [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]


def _cell(value: Any) -> Any:
    return "" if value is None or value != value else value
