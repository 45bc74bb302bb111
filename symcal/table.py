"""CSV files read strictly: every cell keeps its line, every column its unit, and what cannot be read is named."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.units import ANGLE, LENGTH, PIXEL, split_unit

Array = NDArray[np.float64]

_DELIMITERS = (",", ";", "\t")
_NAMED = 5  # rows named one by one in a message


@dataclass(frozen=True, slots=True)
class Table:
    """A CSV file as text cells. columns: header names; lines: line in the file of every row."""

    path: Path
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    decimal: str = "."

    def __len__(self) -> int:
        return len(self.rows)

    def text(self, column: str) -> list[str]:
        """The cells of a column."""
        i = self.columns.index(column)
        return [row[i] for row in self.rows]

    def numbers(self, column: str, factor: float = 1.0, *, empty: bool = False) -> Array:
        """A column as numbers times ``factor``, shape (rows,).

        Args:
            empty: whether an empty cell is allowed; it becomes NaN.
        Raises:
            InputError: a cell is not a finite number; names the lines.
        """
        values = np.full(len(self), np.nan)
        bad: list[tuple[int, str]] = []
        for i, cell in enumerate(self.text(column)):
            if not cell and empty:
                continue
            try:
                values[i] = float(cell.replace(self.decimal, ".") if self.decimal != "." else cell)
            except ValueError:
                bad.append((i, cell))
                continue
            if not math.isfinite(values[i]):
                bad.append((i, cell))
        if bad:
            first, cell = bad[0]
            more = ", ".join(str(self.lines[i]) for i, _ in bad[1:_NAMED])
            tail = f"; so are lines {more}{', ...' if len(bad) > _NAMED else ''}" if len(bad) > 1 else ""
            message = f"{'an empty cell' if not cell else 'not a finite number'}{tail}; mend or remove the row"
            raise InputError(message, file=self.path, line=self.lines[first], key=column, found=cell or None)
        return values * factor

    def stems(self) -> dict[str, tuple[str, str | None]]:
        """Column stem -> (column, unit): `q1_deg` is found under `q1`.

        Raises:
            InputError: two columns differ in their unit only.
        """
        found: dict[str, tuple[str, str | None]] = {}
        for column in self.columns:
            stem, unit = split_unit(column)
            if stem in found:
                message = f"columns '{found[stem][0]}' and '{column}' are the same quantity twice"
                raise InputError(message, file=self.path, line=1)
            found[stem] = (column, unit)
        return found

    def quantity(self, stem: str, kinds: Mapping[str, float], what: str, *, empty: bool = False) -> Array:
        """The column `<stem>_<unit>` in mm, rad or px.

        Args:
            kinds: allowed units with their factors (`LENGTH`, `ANGLE`, `PIXEL`). what: the quantity in words, for
                the message.
        Raises:
            InputError: no such column, no unit in its name, or a unit of another kind.
        """
        found = self.stems().get(stem)
        if found is None:
            raise InputError(
                f"there is no column for {what}: expected '{stem}_<unit>'",
                file=self.path,
                line=1,
                key=stem,
                allowed=[f"{stem}_{unit}" for unit in kinds],
            )
        column, unit = found
        if unit is None or unit not in kinds:
            problem = "has no unit" if unit is None else f"has the unit '{unit}'"
            message = f"the column of {what} {problem}: name it with its unit, or map it under 'columns:'"
            raise InputError(
                message, file=self.path, line=1, key=column, found=column, allowed=[f"{stem}_{u}" for u in kinds]
            )
        return self.numbers(column, kinds[unit], empty=empty)


def read_table(
    path: Path | str,
    columns: Mapping[str, str] | None = None,
    *,
    delimiter: str | None = None,
    decimal: str = ".",
) -> Table:
    """Read a CSV file with one header line; lines that start with '#' and blank lines are passed over.

    Args:
        columns: canonical name -> name in the file, for columns that are called otherwise there.
        delimiter: found from the header when None: comma, semicolon or tab. decimal: the decimal sign of the file.
    Raises:
        InputError: no such file, not text, no header, a name twice, a mapped column that is not there, a row of
        another length.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError("there is no such file", file=path) from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"the file cannot be read as UTF-8 text: {error}", file=path) from None
    lines = text.splitlines(keepends=True)
    content = [(i, line) for i, line in enumerate(lines, start=1) if line.strip() and not line.lstrip().startswith("#")]
    if not content:
        raise InputError("the file is empty", file=path)
    if delimiter is None:
        delimiter = max(_DELIMITERS, key=content[0][1].count)
    try:
        parsed = [
            (number, tuple(cell.strip() for cell in row))
            for (number, line) in content
            for row in csv.reader([line], delimiter=delimiter, strict=True)
        ]
    except csv.Error as error:
        raise InputError(f"not a CSV file: {error}", file=path) from None
    head_line, header = parsed[0]
    for name in header:
        if header.count(name) > 1:
            raise InputError("two columns have this name", file=path, line=head_line, found=name or "(empty)")
    for number, row in parsed[1:]:
        if len(row) != len(header):
            message = f"this row has {len(row)} cells, the header {len(header)}"
            raise InputError(message, file=path, line=number)
    return Table(
        path,
        _renamed(path, head_line, header, columns or {}),
        tuple(row for _, row in parsed[1:]),
        tuple(number for number, _ in parsed[1:]),
        decimal,
    )


def _renamed(path: Path, line: int, header: Sequence[str], columns: Mapping[str, str]) -> tuple[str, ...]:
    for canonical, name in columns.items():
        if name not in header:
            message = f"'columns:' maps '{canonical}' to a column that the file does not have"
            raise InputError(message, file=path, line=line, found=name, allowed=header)
    back = {name: canonical for canonical, name in columns.items()}
    renamed = tuple(back.get(name, name) for name in header)
    for name in columns:
        if renamed.count(name) > 1:
            raise InputError(
                "'columns:' gives this name to a column, and another has it", file=path, line=line, found=name
            )
    return renamed


def joint_readings(table: Table, joints: Iterable[tuple[str, bool]]) -> Array:
    """Joint columns `q1..qn` or the joints' names, each with its unit, as rad and mm; shape (rows, n).

    Args:
        joints: (name, revolute) of every joint in order.
    Raises:
        InputError: a column is missing, has no unit or the wrong kind of unit, or a cell is no number.
    """
    stems = table.stems()
    out = []
    for i, (name, revolute) in enumerate(joints, start=1):
        stem = name if name in stems else f"q{i}"
        kind = "revolute: an angle" if revolute else "prismatic: a length"
        out.append(table.quantity(stem, ANGLE if revolute else LENGTH, f"joint {i} '{name}' ({kind})"))
    return np.column_stack(out) if out else np.zeros((len(table), 0))


__all__ = ["ANGLE", "LENGTH", "PIXEL", "Table", "joint_readings", "read_table"]
