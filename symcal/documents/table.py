"""CSV files read strictly: every cell keeps its line, every column its unit, and what cannot be read is named."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symcal.documents.read import CONTROL, TABLE_LIMIT, read_text
from symcal.errors import InputError
from symcal.units import ANGLE, LENGTH, PIXEL, split_unit

Array = NDArray[np.float64]

_DELIMITERS = (",", ";", "\t")
_DIGITS = 400  # of a number; 1e-308 written out has 324
_MOST_ROWS, _MOST_COLUMNS, _MOST_CELLS = 250_000, 10_000, 4_000_000

LARGEST = 1e12
"""Beyond this a cell is no length, angle or pixel, in whatever unit: its powers would overflow."""

_NAMED = 5  # rows named one by one in a message
_NUMBER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")  # float() would also take 1_000 and nan


@dataclass(frozen=True, slots=True)
class Table:
    """A CSV file as text cells.

    columns: header names. lines, head_line: where in the file every row and the header stand. hidden: lines with as
        many cells that begin with '#' and are therefore no rows.
    """

    path: Path
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    head_line: int = 1
    decimal: str = "."
    hidden: int = 0

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
        cells = self.text(column)
        plain = cells if self.decimal == "." else [c.replace(".", "?").replace(self.decimal, ".") for c in cells]
        number = _NUMBER.fullmatch
        values = np.array([float(cell) if len(cell) <= _DIGITS and number(cell) else np.nan for cell in plain])
        wrong = np.flatnonzero(~(np.abs(values) <= LARGEST)).tolist()
        bad = [i for i in wrong if cells[i]] if empty else wrong
        if bad:
            cell = cells[bad[0]]
            comma = self.decimal == "." and "," in cell and _NUMBER.fullmatch(cell.replace(",", ".", 1))
            problem = (
                "an empty cell"
                if not cell
                else f"no number here can be larger than {LARGEST:g}"
                if np.isfinite(values[bad[0]])
                else "a decimal comma: say \"decimal: ','\" where the experiment names the file"
                if comma
                else "not a finite number"
            )
            more = ", ".join(str(self.lines[i]) for i in bad[1:_NAMED]) + (", ..." if len(bad) > _NAMED else "")
            message = f"{problem}{f' (also in line {more})' if more else ''}"
            message += "" if comma else "; mend or remove the row"
            raise InputError(message, file=self.path, line=self.lines[bad[0]], column=column, found=cell or None)
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
                raise InputError(message, file=self.path, line=self.head_line)
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
        column, unit = self.stems().get(stem, (None, None))
        if column is None:
            raise self.missing(what, [stem], kinds)
        if unit is None or unit not in kinds:
            problem = "has no unit" if unit is None else f"has the unit '{unit}'"
            message = f"the column of {what} {problem}: name it with its unit, or map it under 'columns'"
            allowed = [f"{stem}_{u}" for u in kinds]
            raise InputError(message, file=self.path, line=self.head_line, column=column, allowed=allowed)
        return self.numbers(column, kinds[unit], empty=empty)

    def where(self, wanted: Mapping[str, str]) -> Table:
        """The rows whose cells are these.

        Raises:
            InputError: no such column, or no such row.
        """
        table = self
        for column, value in wanted.items():
            if column not in table.columns:
                message = "'where:' names a column that the file does not have"
                raise InputError(message, file=self.path, line=self.head_line, found=column, allowed=self.columns)
            cells = table.text(column)
            kept = [i for i, cell in enumerate(cells) if cell == value]
            if not kept:
                message = f"no row has '{value}' under '{column}'"
                raise InputError(message, file=self.path, found=value, allowed=dict.fromkeys(cells))
            rows, lines = tuple(table.rows[i] for i in kept), tuple(table.lines[i] for i in kept)
            table = replace(table, rows=rows, lines=lines)
        return table

    def with_compound(self, name: str, parts: Sequence[str]) -> Table:
        """With a column more, made of the cells of several: `front/0`.

        Raises:
            InputError: no such column.
        """
        for part in parts:
            if part not in self.columns:
                message = f"'columns:' makes '{name}' of a column that the file does not have"
                raise InputError(message, file=self.path, line=self.head_line, found=part, allowed=self.columns)
        cells = zip(*(self.text(part) for part in parts), strict=True)
        own = [i for i, column in enumerate(self.columns) if column != name]
        rows = [(*(row[i] for i in own), "/".join(cell)) for row, cell in zip(self.rows, cells, strict=True)]
        return replace(self, columns=(*(self.columns[i] for i in own), name), rows=tuple(rows))

    def without(self, column: str) -> Table:
        """Without a column."""
        own = [i for i, name in enumerate(self.columns) if name != column]
        rows = tuple(tuple(row[i] for i in own) for row in self.rows)
        return replace(self, columns=tuple(self.columns[i] for i in own), rows=rows)

    def missing(self, what: str, stems: Sequence[str], kinds: Iterable[str]) -> InputError:
        """The error for a quantity that no column gives, with the columns that come closest."""
        expected = " or ".join(f"'{stem}_<unit>'" for stem in stems)
        near = [c for c in self.columns for stem in stems if c.lower().startswith(f"{stem.lower()}_")]
        if not near:
            own = {split_unit(c)[0].lower(): c for c in self.columns}
            near = [own[stem] for stem in get_close_matches(stems[0].lower(), own, n=1, cutoff=0.75)]
        hint = f"; is it '{near[0]}'? then name it so, or map it under 'columns'" if near else ""
        message = f"there is no column for {what}: expected {expected} with a unit of {', '.join(kinds)}{hint}"
        return InputError(message, file=self.path, line=self.head_line, found=", ".join(self.columns))


def read_table(
    path: Path | str,
    columns: Mapping[str, str] | None = None,
    *,
    delimiter: str | None = None,
    decimal: str = ".",
) -> Table:
    """Read a CSV file with one header line; lines that start with '#' and empty ones are passed over.

    Args:
        columns: canonical name -> name in the file, for columns that are called otherwise there.
        delimiter: found from the header when None: comma, semicolon or tab. decimal: the decimal sign of the file.
    Raises:
        InputError: no such file, not text, no header, a name twice, a mapped column that is not there, a row of
        another length, or more rows or cells than are read.
    """
    path = Path(path)
    text = read_text(path, TABLE_LIMIT, "utf-8-sig")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    odd = CONTROL.search(text)
    if odd:
        line = text.count("\n", 0, odd.start()) + 1
        raise InputError("a control character in the text: is this a CSV file?", file=path, line=line)
    lines = text.split("\n")
    content = [(i, line) for i, line in enumerate(lines, start=1) if line.strip() and not line.lstrip().startswith("#")]
    if not content:
        raise InputError("the file is empty", file=path)
    delimiter = delimiter or max(_DELIMITERS, key=content[0][1].count)
    count, cells = len(content) - 1, text.count(delimiter) + len(content)
    if count > _MOST_ROWS or cells > _MOST_CELLS:
        limits = f"at most {_MOST_ROWS} rows and {_MOST_CELLS} cells are read: take every n-th pose"
        raise InputError(f"the table has {count} rows and {cells} cells; {limits}", file=path)
    parsed = [(number, _cells(path, number, line, delimiter)) for number, line in content]
    (head_line, header), rows = parsed[0], [(number, row) for number, row in parsed[1:] if any(row)]
    if len(header) > _MOST_COLUMNS:
        raise InputError(f"the table has {len(header)} columns: at most {_MOST_COLUMNS} are read", file=path)
    if all(_NUMBER.fullmatch(name) for name in header):
        message = "the first line must name the columns, each with its unit: here it is numbers"
        raise InputError(message, file=path, line=head_line)
    for number, row in rows:
        if len(row) != len(header):
            message = f"this row has {len(row)} cells, the header {len(header)}"
            raise InputError(message, file=path, line=number)
    hidden = sum(line.lstrip().startswith("#") and line.count(delimiter) == len(header) - 1 > 0 for line in lines)
    named = [i for i, name in enumerate(header) if name or any(row[i] for _, row in rows)]  # spreadsheets leave ',,'
    header = tuple(header[i] for i in named)
    times = Counter(header)
    for name in header:
        if not name or times[name] > 1:
            message = "two columns have this name" if name else "a column without a name"
            raise InputError(message, file=path, line=head_line, found=name or None)
    return Table(
        path,
        _renamed(path, head_line, header, columns or {}),
        tuple(tuple(row[i] for i in named) for _, row in rows),
        tuple(number for number, _ in rows),
        head_line,
        decimal,
        hidden,
    )


def _cells(path: Path, number: int, line: str, delimiter: str) -> tuple[str, ...]:
    try:
        (row,) = csv.reader([line], delimiter=delimiter, strict=True)
    except csv.Error as error:
        raise InputError(f"not a line of a CSV file: {error}", file=path, line=number) from None
    return tuple(cell.strip() for cell in row)


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


def joint_readings(table: Table, joints: Iterable[tuple[str, bool]], measured: Collection[str] = ()) -> Array:
    """Joint columns `q1..qn` or the joints' names, each with its unit, as rad and mm; shape (rows, n).

    Args:
        joints: (name, revolute) of every joint in order. measured: stems of columns that hold measurements (`x`): a
            joint of such a name (a gantry's) must come as `q1`.
    Raises:
        InputError: a column is missing or given under both names, has no unit or the wrong kind of unit, or a cell is
        no number.
    """
    stems = table.stems()
    out = []
    for i, (name, revolute) in enumerate(joints, start=1):
        what = f"joint {i} '{name}' ({'revolute: an angle' if revolute else 'prismatic: a length'})"
        if name in measured:
            what += f", whose name is also that of a measured '{name}'"
        kinds = ANGLE if revolute else LENGTH
        names = [f"q{i}", *([] if name in (*measured, f"q{i}") else [name])]
        given = [stem for stem in names if stem in stems]
        if not given:
            raise table.missing(what, names[::-1], kinds)
        if len(given) > 1:
            message = f"{what} has two columns, '{stems[given[0]][0]}' and '{stems[given[1]][0]}': keep one"
            raise InputError(message, file=table.path, line=table.head_line)
        out.append(table.quantity(given[0], kinds, what))
    return np.column_stack(out) if out else np.zeros((len(table), 0))


__all__ = ["ANGLE", "LENGTH", "PIXEL", "Table", "joint_readings", "read_table"]
