"""The decimal sign of a table, found from its first rows: a comma counts only where it cannot be anything else."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import chain, islice
from pathlib import Path

from symcal.errors import InputError
from symcal.units import split_unit

_LOOKED = 1000  # rows
_POINT = re.compile(r"[-+]?\d*\.\d+([eE][-+]?\d+)?|[-+]?\d+\.\d*([eE][-+]?\d+)?")
_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?|[-+]?\d+,\d*([eE][-+]?\d+)?")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
_ADVICE = "say \"decimal: ','\" or \"decimal: '.'\" where the experiment names the file"


def found_decimal(path: Path, columns: Sequence[str], cells: Sequence[Sequence[str]]) -> tuple[str, tuple[str, ...]]:
    """The decimal sign of a file, and what is to be said of it.

    Args:
        cells: of every column, in pieces, a line feed between two.
    Raises:
        InputError: some numbers have a point and others a comma, or every comma may as well part thousands (`1,234`).
    """
    measured = [column for column in columns if split_unit(column)[1]] or columns  # '1,5' may be a remark
    looked = {
        column: list(islice(chain.from_iterable(piece.split("\n", _LOOKED)[:_LOOKED] for piece in pieces), _LOOKED))
        for column, pieces in zip(columns, cells, strict=True)
        if column in measured
    }
    if not any("," in cell for own in looked.values() for cell in own):
        return ".", ()
    pointed = comma = telling = None
    for column, own in looked.items():
        for cell in own:
            if "," in cell and _COMMA.fullmatch(cell):
                comma = comma or (column, cell)
                if not _THOUSANDS.fullmatch(cell):
                    telling = telling or cell
            elif "." in cell and _POINT.fullmatch(cell):
                pointed = pointed or (column, cell)
    if comma is None:
        return ".", ()
    if pointed is not None:
        message = (
            f"some numbers have a decimal comma and others a point ('{pointed[1]}' under '{pointed[0]}'): {_ADVICE}"
        )
        raise InputError(message, file=path, column=comma[0], found=comma[1], allowed=("','", "'.'"))
    if telling is None:
        message = f"this comma may be a decimal comma or part thousands, and no number of the file tells: {_ADVICE}"
        raise InputError(message, file=path, column=comma[0], found=comma[1], allowed=("','", "'.'"))
    return ",", (f"numbers of the file have decimal commas, such as {telling} ('decimal' says otherwise)",)
