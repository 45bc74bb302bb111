"""How a file of measurements is laid out: its columns, the rows that count, its signs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from symcal.documents.csv_file import read_table
from symcal.documents.table import Table
from symcal.errors import InputError


@dataclass(frozen=True, slots=True)
class Layout:
    """How a file is to be read.

    columns: canonical name -> name in the file, or names of several columns whose cells make one. where: cells by
    column of the rows that count.
    """

    columns: Mapping[str, str | Sequence[str]] = field(default_factory=dict)
    where: Mapping[str, str] = field(default_factory=dict)
    delimiter: str | None = None
    decimal: str = "."

    def table(self, path: Path | str) -> Table:
        """The file's rows that count, with canonical names.

        Raises:
            InputError: as `symcal.documents.table.read_table` says, no such column or row, or no rows at all.
        """
        single = {canonical: name for canonical, name in self.columns.items() if isinstance(name, str)}
        table = read_table(path, single, delimiter=self.delimiter, decimal=self.decimal).where(self.where)
        if not len(table):
            raise InputError("the file has a header but no rows", file=path)
        for canonical, names in self.columns.items():
            if not isinstance(names, str):
                table = table.with_compound(canonical, names)
        return table
