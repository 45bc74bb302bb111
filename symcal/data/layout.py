"""How files of measurements are laid out: their columns, the rows that count, their signs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from symcal.documents.csv_file import read_table
from symcal.documents.table import Table
from symcal.errors import InputError
from symcal.readers.several import insist_on_difference, joined, short_names
from symcal.readers.sheets import is_sheets, read_sheet


@dataclass(frozen=True, slots=True)
class Layout:
    """How files are to be read.

    columns: canonical name -> name in the file, or names of several columns whose cells make one. where: cells by
    column of the rows that count. delimiter, decimal: of CSV files; found out where None. sheet: of files with sheets.
    session_per_file: whether every file is a session of its own, called like it.
    """

    columns: Mapping[str, str | Sequence[str]] = field(default_factory=dict)
    where: Mapping[str, str] = field(default_factory=dict)
    delimiter: str | None = None
    decimal: str | None = None
    sheet: str | None = None
    session_per_file: bool = False

    def table(self, path: Path | str | Sequence[Path]) -> Table:
        """The rows that count of a file or of several, with canonical names.

        Raises:
            InputError: as `symcal.documents.csv_file.read_table` or `symcal.readers.sheets.read_sheet` says, no such
            column or row, no rows at all, or files that do not go together.
        """
        paths = [Path(path)] if isinstance(path, Path | str) else list(path)
        names = short_names(paths)
        if len(paths) > 1:
            insist_on_difference(paths)
        table = joined([self._read(each) for each in paths], names).where(self.where)
        if self.session_per_file:
            if "session" in table.columns:
                message = "'session: file' names sessions by their files, and the file has a column 'session'"
                raise table.error(message, column="session")
            own = [names[0]] * len(table) if table.of is None else [names[i] for i in table.of]
            table = table.with_column("session", "\n".join(own))
        for canonical, parts in self.columns.items():
            if not isinstance(parts, str):
                table = table.with_compound(canonical, parts)
        return table

    def _read(self, path: Path) -> Table:
        single = {canonical: name for canonical, name in self.columns.items() if isinstance(name, str)}
        if is_sheets(path):
            if self.delimiter is not None or self.decimal is not None:
                message = "a sheet has cells and numbers: leave 'delimiter' and 'decimal' out"
                raise InputError(message, file=path)
            table = read_sheet(path, self.sheet, single)
        else:
            if self.sheet is not None:
                raise InputError("'sheet' names one of an Excel or ODS file", file=path, found=self.sheet)
            table = read_table(path, single, delimiter=self.delimiter, decimal=self.decimal)
        if not len(table):
            raise InputError("the file has a header but no rows", file=path, part=table.part or None)
        return table
