"""Sheets of Excel and ODS files, read with python-calamine into the same tables as CSV files.

Rows are those that the sheet shows. Dates, truth values and errors become text, which no column of numbers takes: an
error then names the cell; in columns that are not read they do no harm.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.parsers import expat
from zipfile import ZipFile

from symcal.documents.csv_file import canonical_names, check_header
from symcal.documents.read import CONTROL, MB, read_bytes
from symcal.documents.table import Table
from symcal.errors import InputError

if TYPE_CHECKING:
    from python_calamine import CalamineSheet

SUFFIXES = (".xlsx", ".xlsm", ".xls", ".ods")
"""Files with sheets, by the end of their name."""

_LIMIT = 256 * MB  # of a file, and of what is packed in one
_MOST_CELLS = 20_000_000  # of a sheet: the library holds them all, the empty ones between two far ones too
_WHOLE = 2**53


def is_sheets(path: Path | str) -> bool:
    """Whether a file is one with sheets, by its name."""
    return Path(path).suffix.lower() in SUFFIXES


def read_sheet(path: Path | str, sheet: str | None = None, columns: Mapping[str, str] | None = None) -> Table:
    """Read a sheet: the first row that is not empty names the columns; empty rows, and those beginning with '#', are
    passed over.

    Args:
        sheet: its name; may be left out where only one sheet is not empty. columns: canonical name -> name in the
            sheet, for columns that are called otherwise there.
    Raises:
        InputError: no such file or sheet, not a file with sheets, several sheets and none named, merged cells in the
        table, no header, a name twice, a cell without a column, or a mapped column that is not there.
    """
    path = Path(path)
    content = read_bytes(path, _LIMIT)
    found = _opened(path, content, sheet)
    part = f"sheet '{found.name}'"
    rows = [[_text(cell) for cell in row] for row in found.to_python(skip_empty_area=False)]
    for at, row in enumerate(rows):
        odd = next((cell for cell in row if CONTROL.search(cell)), None)
        if odd is not None:
            raise InputError("a control character in this row", file=path, line=at + 1, part=part, found=odd)
    begin = [next(filter(None, row), "") for row in rows]
    kept = [at for at, first in enumerate(begin) if first and not first.startswith("#")]
    if not kept:
        raise InputError("the sheet is empty", file=path, part=part)
    top, *own = kept
    head = rows[top]
    width = 1 + max(k for at in kept for k, cell in enumerate(rows[at]) if cell)
    _check_merged(path, part, found, top, width)
    named = [k for k in range(width) if head[k] or any(rows[at][k] for at in own)]
    header = tuple(head[k] for k in named)
    check_header(path, top + 1, header, part)
    for k, name in zip(named, header, strict=True):
        if not name:
            at = next(at for at in own if rows[at][k])
            message = f"a cell in column {_letters(k)}, which has no name"
            raise InputError(message, file=path, line=at + 1, part=part, found=rows[at][k])
    canonical = canonical_names(path, top + 1, header, columns or {}, part)
    cells = tuple(("\n".join([rows[at][k] for at in own]),) if own else () for k in named)
    comments = [row for row, first in zip(rows, begin, strict=True) if first.startswith("#")]
    hidden = sum(sum(map(bool, row)) == len(header) > 1 for row in comments)
    lines = array("q", [at + 1 for at in own])
    return Table(path, canonical, cells, lines, top + 1, ".", hidden, part=part)


def _opened(path: Path, content: bytes, sheet: str | None) -> CalamineSheet:
    """The sheet that is meant."""
    from python_calamine import CalamineWorkbook

    try:
        if not content.startswith(_OLD):
            _insist_on_size(path, content)
        book = CalamineWorkbook.from_filelike(BytesIO(content))
        names = book.sheet_names
        if sheet is not None:
            if sheet not in names:
                raise InputError("there is no such sheet", file=path, found=sheet, allowed=names)
            return book.get_sheet_by_name(sheet)
        sheets = [book.get_sheet_by_name(name) for name in names]
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - a damaged file is packed, XML and cells, and each has errors of its own
        message = f"the file cannot be read as one with sheets: {' '.join(str(error).split())}"
        raise InputError(message, file=path) from None
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # of Rust, which is no Exception
            raise
        raise InputError("the file cannot be read as one with sheets: it is damaged", file=path) from None
    filled = [each for each in sheets if each.end is not None]
    if len(filled) > 1:
        message = "the file has several sheets: say which with 'sheet:' where the experiment names the file"
        raise InputError(message, file=path, allowed=[each.name for each in filled])
    if not filled:
        raise InputError("no sheet of the file has a cell", file=path)
    return filled[0]


_OLD = b"\xd0\xcf\x11\xe0"  # of .xls, whose sheets are small


def _insist_on_size(path: Path, content: bytes) -> None:
    """Refuse what would take all memory to read, or all time: the library makes room for every cell up to the last one,
    and looks for the end of what has none.

    Raises:
        InputError: too much is packed in the file, a sheet reaches too far, or a part is no XML.
    """
    with ZipFile(BytesIO(content)) as packed:
        if sum(each.file_size for each in packed.infolist()) > _LIMIT:
            raise InputError(f"more than {_LIMIT // MB} MB are packed in the file", file=path)
        for name in packed.namelist():
            if name.endswith((".xml", ".rels")):
                _insist_on_xml(path, name, packed.read(name))
            if re.fullmatch(r"xl/worksheets/[^/]+\.xml", name):
                _check_reach(path, _reach(packed.read(name)))
            elif name == "content.xml":
                _check_reach(path, _repeated(packed.read(name)))


def _insist_on_xml(path: Path, name: str, content: bytes) -> None:
    try:
        expat.ParserCreate().Parse(content, True)
    except expat.ExpatError as error:
        what = expat.errors.messages[error.code]
        raise InputError(f"the file is damaged: its part {name} is not valid XML: {what}", file=path) from None


def _check_reach(path: Path, cells: int) -> None:
    if cells > _MOST_CELLS:
        message = (
            f"a sheet with room for {cells} cells: at most {_MOST_CELLS} are read (is there one far from the table?)"
        )
        raise InputError(message, file=path)


def _reach(sheet: bytes) -> int:
    """Cells of an Excel sheet up to the last row and column."""
    rows = columns = 0
    for letters, number in set(re.findall(rb"""\br=["']([A-Z]{1,3})(\d{1,7})["']""", sheet)):
        rows, columns = max(rows, int(number)), max(columns, _number(letters))
    return rows * columns


def _repeated(content: bytes) -> int:
    """Cells of ODS sheets up to the last one of each row that says something, those said once for many among them."""
    total = 0
    for row in re.split(rb"<[\w-]+:table-row\b", content)[1:]:
        head, _, rest = row.partition(b">")
        tags = re.findall(rb"<[\w-]+:(?:covered-)?table-cell\b([^>]*)>", rest)
        while tags and tags[-1].endswith(b"/") and b"value" not in tags[-1]:
            tags.pop()
        if tags:
            total += _times(b"rows", head) * sum(_times(b"columns", tag) for tag in tags)
    return total


def _times(what: bytes, tag: bytes) -> int:
    found = re.search(rb"number-" + what + rb"""-repeated=["'](\d{1,9})["']""", tag)
    return int(found[1]) if found else 1


def _number(letters: bytes) -> int:
    out = 0
    for letter in letters:
        out = 26 * out + letter - ord("A") + 1
    return out


def _letters(index: int) -> str:
    text, index = "", index + 1
    while index:
        index, left = divmod(index - 1, 26)
        text = chr(ord("A") + left) + text
    return text


def _check_merged(path: Path, part: str, sheet: CalamineSheet, top: int, width: int) -> None:
    """Refuse merged cells in the table: all but one of them are empty, whatever is meant."""
    for (first, left), (last, right) in sheet.merged_cell_ranges or ():
        if last >= top and left < width:
            where = f"{_letters(left)}{first + 1}:{_letters(right)}{last + 1}"
            message = "merged cells in the table, of which only the first has a value: part them and fill each"
            raise InputError(message, file=path, line=first + 1, part=part, found=where)


def _text(cell: Any) -> str:
    """A cell as a CSV file would have it; numbers with all their digits."""
    if isinstance(cell, bool):
        return str(cell).lower()
    if isinstance(cell, float):
        return str(int(cell)) if cell.is_integer() and abs(cell) < _WHOLE else repr(cell)
    if isinstance(cell, str):
        return " ".join(cell.split())
    return cell.isoformat() if hasattr(cell, "isoformat") else str(cell)
