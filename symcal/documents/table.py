"""Tables of text cells: every cell keeps its line, every column its unit, and what cannot be read is named."""

from __future__ import annotations

import re
from array import array
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path

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
class Table:
    """Text cells of a CSV file.

    columns: header names. cells: of every column, in pieces of consecutive rows, a line feed between two. lines,
        head_line: where in the file every row and the header stand. hidden: lines with as many cells that begin with
        '#' and are therefore no rows.
    """

    path: Path
    columns: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]
    lines: range | array[int]
    head_line: int = 1
    decimal: str = "."
    hidden: int = 0

    def __len__(self) -> int:
        return len(self.lines)

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
            if len(kept) < len(cells):
                table = table._take(kept)
        return table

    def _take(self, rows: Sequence[int]) -> Table:
        """Some rows, in their order."""
        chosen = []
        for column in self.columns:
            cells = self.text(column)
            chosen.append(("\n".join([cells[i] for i in rows]),))
        return replace(self, cells=tuple(chosen), lines=array("q", [self.lines[i] for i in rows]))

    def with_compound(self, name: str, parts: Sequence[str]) -> Table:
        """With a column more, made of the cells of several: `front/0`.

        Raises:
            InputError: no such column.
        """
        for part in parts:
            if part not in self.columns:
                message = f"'columns:' makes '{name}' of a column that the file does not have"
                raise InputError(message, file=self.path, line=self.head_line, found=part, allowed=self.columns)
        made = "\n".join(map("/".join, zip(*(self.text(part) for part in parts), strict=True)))
        own = self.without(name)
        return replace(own, columns=(*own.columns, name), cells=(*own.cells, (made,)))

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
        return InputError(message, file=self.path, line=self.head_line, found=", ".join(self.columns))


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
            raise InputError(message, file=table.path, line=table.head_line)
        out.append(table.quantity(given[0], kinds, what))
    return np.column_stack(out) if out else np.zeros((len(table), 0))


__all__ = ["ANGLE", "LENGTH", "PIXEL", "Table", "joint_readings"]
