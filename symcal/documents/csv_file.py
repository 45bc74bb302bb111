"""CSV files read strictly, a piece at a time: whatever is no table of rows as long as its header is named."""

from __future__ import annotations

import csv
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path

from symcal.documents.decimal_sign import found_decimal
from symcal.documents.read import CONTROL, MB, TABLE_LIMIT, read_pieces
from symcal.documents.table import NUMBER, Table
from symcal.errors import InputError

_DELIMITERS = (",", ";", "\t")
_MOST_ROWS, _MOST_COLUMNS, _MOST_CELLS = 10_000_000, 10_000, 100_000_000
_PIECE = 4 * MB  # taken apart at once: a cell as a text of its own takes ten times its bytes
_ORDINARY = bytes([9, 10, *range(32, 127)])

Lines = tuple[Sequence[int], Sequence[str]]
"""Lines of a file, with their numbers before them."""


def read_table(
    path: Path | str,
    columns: Mapping[str, str] | None = None,
    *,
    delimiter: str | None = None,
    decimal: str | None = ".",
    piece: int = _PIECE,
) -> Table:
    """Read a CSV file with one header line; lines that start with '#' and empty ones are passed over.

    Args:
        columns: canonical name -> name in the file, for columns that are called otherwise there.
        delimiter: found from the header when None: comma, semicolon or tab. decimal: the decimal sign of the file;
            found from its first rows when None, and what was found is among the table's notes.
        piece: bytes of the file that are looked at together.
    Raises:
        InputError: no such file, not text, no header, a name twice, a mapped column that is not there, a row of
        another length, more rows or cells than are read, or a header or numbers that can be read in two ways.
    """
    path = Path(path)
    pieces = _pieces(path, piece)
    first = next((each for each in pieces if each[0][1]), None)
    if first is None:
        raise InputError("the file is empty", file=path)
    ((head_line, *numbers), (head, *lines)), comments = first
    separator = delimiter or _delimiter(path, head_line, head)
    header = _cells(path, head_line, head, separator)
    check_header(path, head_line, header)
    cells: list[list[str]] = [[] for _ in header]
    places: list[Sequence[int]] = []
    hidden = count = 0
    for given, passed in chain([((numbers, lines), comments)], pieces):
        hidden += sum(line.count(separator) == len(header) - 1 > 0 for line in passed)
        own, found = _rows(path, given, separator, len(header))
        if not own:
            continue
        count += len(own)
        if count > _MOST_ROWS or count * len(header) > _MOST_CELLS:
            limits = f"at most {_MOST_ROWS} rows and {_MOST_CELLS} cells are read: take every n-th pose"
            message = f"the table has {count} rows or more, of {len(header)} cells each; {limits}"
            raise InputError(message, file=path)
        places.append(own)
        for column, part in zip(cells, found, strict=True):
            column.append("\n".join(part))
    named = [i for i, name in enumerate(header) if name or any(part.strip("\n") for part in cells[i])]
    header = tuple(header[i] for i in named)  # spreadsheets leave ',,'
    canonical = canonical_names(path, head_line, header, columns or {})
    kept = tuple(tuple(cells[i]) for i in named)
    sign, notes = (decimal, ()) if decimal else found_decimal(path, canonical, kept)
    if notes and delimiter is None and separator != ",":
        notes = (f"the cells of the file are separated by {separator!r}, as its header says", *notes)
    return Table(path, canonical, kept, _joined(places), head_line, sign, hidden, notes=notes)


def _delimiter(path: Path, line: int, head: str) -> str:
    """What separates the cells of a header.

    Raises:
        InputError: two of them stand in it equally often.
    """
    most = max(map(head.count, _DELIMITERS))
    found = [each for each in _DELIMITERS if head.count(each) == most]
    if most and len(found) > 1:
        message = "the header can be taken apart in two ways: say 'delimiter:' where the experiment names the file"
        raise InputError(message, file=path, line=line, found=head, allowed=map(repr, found))
    return found[0]


def _pieces(path: Path, piece: int) -> Iterator[tuple[Lines, list[str]]]:
    """Lines that say something, and those that are comments.

    Raises:
        InputError: it is no text.
    """
    before = 0
    for text in read_pieces(path, TABLE_LIMIT, piece):
        odd = None if text.isascii() and not text.encode().translate(None, _ORDINARY) else CONTROL.search(text)
        if odd:
            line = before + text.count("\n", 0, odd.start()) + 1
            raise InputError("a control character in the text: is this a CSV file?", file=path, line=line)
        lines = text.removesuffix("\n").split("\n")
        numbers: Sequence[int] = range(before + 1, before + len(lines) + 1)
        before += len(lines)
        starts = [line.lstrip()[:1] for line in lines]
        kept = [i for i, start in enumerate(starts) if start not in ("", "#")]
        comments = [line for line, start in zip(lines, starts, strict=True) if start == "#"] if "#" in text else []
        yield _taken((numbers, lines), kept), comments


def check_header(path: Path, line: int, header: Sequence[str], part: str | None = None) -> None:
    """Refuse a header that names nothing.

    Raises:
        InputError: too many columns, or a header of numbers.
    """
    if len(header) > _MOST_COLUMNS:
        raise InputError(f"the table has {len(header)} columns: at most {_MOST_COLUMNS} are read", file=path, part=part)
    if all(NUMBER.fullmatch(name) for name in header):
        message = "the first line must name the columns, each with its unit: here it is numbers"
        raise InputError(message, file=path, line=line, part=part)


def _rows(path: Path, given: Lines, delimiter: str, width: int) -> tuple[Sequence[int], Sequence[Sequence[str]]]:
    """Lines taken apart: the numbers of those that are not blank, and their cells column by column.

    Raises:
        InputError: a line is none of a CSV file, or has another number of cells than the header.
    """
    quoted = any('"' in line for line in given[1])
    if quoted:
        rows = [_cells(path, number, line, delimiter) for number, line in zip(*given, strict=True)]
        kept = [i for i, row in enumerate(rows) if any(row)]
        rows = [rows[i] for i in kept]
    else:
        kept = [i for i, line in enumerate(given[1]) if line.replace(delimiter, " ").strip()]
    numbers, lines = _taken(given, kept)
    for i, line in enumerate(lines):
        found = len(rows[i]) if quoted else line.count(delimiter) + 1
        if found != width:
            raise InputError(f"this row has {found} cells, the header {width}", file=path, line=numbers[i])
    if quoted:
        return numbers, list(zip(*rows, strict=True))
    flat = delimiter.join(lines).split(delimiter)
    return numbers, [list(map(str.strip, flat[i::width])) for i in range(width)]


def _taken(given: Lines, kept: Sequence[int]) -> Lines:
    numbers, lines = given
    return given if len(kept) == len(lines) else ([numbers[i] for i in kept], [lines[i] for i in kept])


def _joined(parts: Sequence[Sequence[int]]) -> range | array[int]:
    """Numbers of lines one after the other; a range where they are one."""
    count = sum(map(len, parts))
    if count and parts[-1][-1] - parts[0][0] + 1 == count:  # they ascend
        return range(parts[0][0], parts[0][0] + count)
    return array("q", chain.from_iterable(parts))


def _cells(path: Path, number: int, line: str, delimiter: str) -> tuple[str, ...]:
    try:
        (row,) = csv.reader([line], delimiter=delimiter, strict=True)
    except csv.Error as error:
        raise InputError(f"not a line of a CSV file: {error}", file=path, line=number) from None
    return tuple(cell.strip() for cell in row)


def canonical_names(
    path: Path, line: int, header: Sequence[str], columns: Mapping[str, str], part: str | None = None
) -> tuple[str, ...]:
    """The names of columns, with those that `columns` gives them: canonical name -> name in the file.

    Raises:
        InputError: a column without a name, a name twice, or a mapped column that is not there.
    """
    times = Counter(header)
    for name in header:
        if not name or times[name] > 1:
            message = "two columns have this name" if name else "a column without a name"
            raise InputError(message, file=path, line=line, part=part, found=name or None)
    for canonical, name in columns.items():
        if name not in header:
            message = f"'columns:' maps '{canonical}' to a column that the file does not have"
            raise InputError(message, file=path, line=line, part=part, found=name, allowed=header)
    back = {name: canonical for canonical, name in columns.items()}
    found = tuple(back.get(name, name) for name in header)
    for name in columns:
        if found.count(name) > 1:
            message = "'columns:' gives this name to a column, and another has it"
            raise InputError(message, file=path, line=line, part=part, found=name)
    return found
