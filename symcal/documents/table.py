"""Tables of text cells: every cell keeps its place, every column its unit, and what cannot be read is named."""

from __future__ import annotations

import re
from array import array
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import SupportsIndex

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError
from symcal.units import ANGLE, LENGTH, PIXEL, split_unit

Array = NDArray[np.float64]

_DIGITS = 400  # of a number; 1e-308 written out has 324
_PLAIN = b"0123456789+-.eE\n"  # where there is nothing else, float() takes what `NUMBER` takes, but for length

LARGEST = 1e12
"""Beyond this a cell is no length, angle or pixel, in whatever unit: its powers would overflow."""

_NAMED = 5  # rows named one by one in a message
NUMBER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
"""A number; float() would also take 1_000 and nan."""


@dataclass(frozen=True, slots=True)
class Origin:
    """A file that rows of a table come from.

    name: what tells it from the others, in labels. part: of the file, as an error names it: a sheet, a topic.
    """

    path: Path
    name: str = ""
    part: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """Text cells of a CSV file, of a sheet, or of what another reader found.

    columns: header names. cells: of every column, in pieces of consecutive rows, a line feed between two. lines,
        head_line: where in the file every row and the header stand; no head_line where rows have no place of their own.
        hidden: lines with as many cells that begin with '#' and are therefore no rows. part: of the file. notes: what
        was found out about the file and is to be said. origins, of: where the rows come from several files, these, and
        the number of the file of every row.
    """

    path: Path
    columns: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]
    lines: range | array[int]
    head_line: int | None = 1
    decimal: str = "."
    hidden: int = 0
    part: str = ""
    notes: tuple[str, ...] = ()
    origins: tuple[Origin, ...] = ()
    of: array[int] | None = None

    def __len__(self) -> int:
        return len(self.lines)

    def origin(self, row: SupportsIndex | None = None) -> Origin:
        """The file of a row; the first one without."""
        if self.of is None:
            return Origin(self.path, part=self.part)
        return self.origins[0 if row is None else self.of[row]]

    def error(
        self,
        message: str,
        *,
        row: SupportsIndex | None = None,
        column: str | None = None,
        found: object = None,
        allowed: Iterable[str] = (),
    ) -> InputError:
        """An error that names the place of a row, or of the header."""
        own = self.origin(row)
        line = None if self.head_line is None else self.head_line if row is None else self.lines[row]
        return InputError(
            message, file=own.path, line=line, part=own.part or None, column=column, found=found, allowed=allowed
        )

    def said(self, row: SupportsIndex) -> str:
        """Where a row stands, in words."""
        what = "row" if self.part else "line"
        return f"{what} {self.lines[row]}" + (f" of {self.origin(row).path.name}" if self.of is not None else "")

    def text(self, column: str) -> list[str]:
        """The cells of a column."""
        return [cell for piece in self.cells[self.columns.index(column)] for cell in piece.split("\n")]

    def numbers(self, column: str, factor: float = 1.0, *, empty: bool = False) -> Array:
        """A column as numbers times ``factor``, shape (rows,).

        Args:
            empty: whether an empty cell is allowed; it becomes NaN.
        Raises:
            InputError: a cell is not a finite number; names the lines.
        """
        pieces = [_numbers(piece, self.decimal) for piece in self.cells[self.columns.index(column)]]
        values = np.concatenate(pieces) if pieces else np.zeros(0)
        wrong = np.flatnonzero(~(np.abs(values) <= LARGEST)).tolist()
        cells = self.text(column) if wrong else []
        bad = [i for i in wrong if cells[i]] if empty else wrong
        if bad:
            cell = cells[bad[0]]
            comma = self.decimal == "." and "," in cell and NUMBER.fullmatch(cell.replace(",", ".", 1))
            problem = (
                _EMPTY[bool(self.part)]
                if not cell
                else f"no number here can be larger than {LARGEST:g}"
                if np.isfinite(values[bad[0]])
                else _comma(bool(self.part))
                if comma
                else _OTHER.get(_kind(cell), "not a finite number")
            )
            also = [i for i in bad[1:] if self.of is None or self.of[i] == self.of[bad[0]]]
            more = ", ".join(str(self.lines[i]) for i in also[: _NAMED - 1]) + (", ..." if len(also) >= _NAMED else "")
            message = problem + (f" (also in {'row' if self.part else 'line'} {more})" if more else "")
            message += "" if comma else "; mend or remove the row"
            raise self.error(message, row=bad[0], column=column, found=cell or None)
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
                raise self.error(message)
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
            raise self.error(message, column=column, allowed=allowed)
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
                raise self.error(message, found=column, allowed=self.columns)
            cells = table.text(column)
            kept = [i for i, cell in enumerate(cells) if cell == value]
            if not kept:
                message = f"no row has '{value}' under '{column}'"
                raise InputError(
                    message, file=self.path, part=self.part or None, found=value, allowed=dict.fromkeys(cells)
                )
            if len(kept) < len(cells):
                table = table._take(kept)
        return table

    def _take(self, rows: Sequence[int]) -> Table:
        """Some rows, in their order."""
        chosen = []
        for column in self.columns:
            cells = self.text(column)
            chosen.append(("\n".join([cells[i] for i in rows]),))
        of = None if self.of is None else array("q", [self.of[i] for i in rows])
        return replace(self, cells=tuple(chosen), lines=array("q", [self.lines[i] for i in rows]), of=of)

    def with_compound(self, name: str, parts: Sequence[str]) -> Table:
        """With a column more, made of the cells of several: `front/0`.

        Raises:
            InputError: no such column.
        """
        for part in parts:
            if part not in self.columns:
                message = f"'columns:' makes '{name}' of a column that the file does not have"
                raise self.error(message, found=part, allowed=self.columns)
        made = "\n".join(map("/".join, zip(*(self.text(part) for part in parts), strict=True)))
        return self.with_column(name, made)

    def with_column(self, name: str, cells: str) -> Table:
        """With a column, instead of one of its name; cells: with a line feed between two."""
        own = self.without(name)
        return replace(own, columns=(*own.columns, name), cells=(*own.cells, (cells,)))

    def without(self, column: str) -> Table:
        """Without a column."""
        own = [i for i, name in enumerate(self.columns) if name != column]
        return replace(self, columns=tuple(self.columns[i] for i in own), cells=tuple(self.cells[i] for i in own))

    def missing(self, what: str, stems: Sequence[str], kinds: Iterable[str]) -> InputError:
        """The error for a quantity that no column gives, with the columns that come closest."""
        expected = " or ".join(f"'{stem}_<unit>'" for stem in stems)
        near = [c for c in self.columns for stem in stems if c.lower().startswith(f"{stem.lower()}_")]
        if not near:
            own = {split_unit(c)[0].lower(): c for c in self.columns}
            near = [own[stem] for stem in get_close_matches(stems[0].lower(), own, n=1, cutoff=0.75)]
        hint = f"; is it '{near[0]}'? then name it so, or map it under 'columns'" if near else ""
        message = f"there is no column for {what}: expected {expected} with a unit of {', '.join(kinds)}{hint}"
        return self.error(message, found=", ".join(self.columns))


_EMPTY = {False: "an empty cell", True: "an empty cell, or one whose formula has no value or an error"}
_OTHER = {
    "truth": "true or false where a number is needed",
    "date": "a date or a time where a number is needed (did the spreadsheet take a number for one?)",
}


def _comma(sheet: bool) -> str:
    if sheet:
        return "text with a decimal comma, where a number is needed: make the cell a number"
    return "a decimal comma: say \"decimal: ','\" where the experiment names the file"


def _kind(cell: str) -> str:
    """What a cell that is no number looks like."""
    if cell.lower() in ("true", "false"):
        return "truth"
    return "date" if re.match(r"\d{4}-\d\d-\d\d|\d{1,2}:\d\d", cell) else ""


def _numbers(piece: str, decimal: str) -> Array:
    """Consecutive cells of a column as numbers; NaN where a cell is none."""
    if decimal != ".":
        piece = piece.replace(".", "?").replace(decimal, ".")
    cells = piece.split("\n")
    if piece.isascii() and not piece.encode().translate(None, _PLAIN) and max(map(len, cells)) <= _DIGITS:
        try:
            return np.fromiter(map(float, cells), np.float64, len(cells))
        except ValueError:  # something like '1-2', or an empty cell
            pass
    number = NUMBER.fullmatch
    return np.array([float(cell) if len(cell) <= _DIGITS and number(cell) else np.nan for cell in cells])


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
            raise table.error(message)
        out.append(table.quantity(given[0], kinds, what))
    return np.column_stack(out) if out else np.zeros((len(table), 0))


__all__ = ["ANGLE", "LENGTH", "PIXEL", "Origin", "Table", "joint_readings"]
