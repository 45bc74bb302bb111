"""Which poses train and which test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from symcal.documents.table import Table


@dataclass(frozen=True, slots=True)
class Split:
    """How poses fall into training and test.

    By the labels of a column, or by a random share; all train without either.
    """

    column: str | None = None
    train: tuple[str, ...] = ("train",)
    test: tuple[str, ...] = ("test",)
    test_fraction: float | None = None


def splits(table: Table, poses: Sequence[object], split: Split, *, alone: bool = True) -> tuple[str, ...]:
    """`train`, `test` or `unused` for every pose.

    Args:
        poses: what tells the pose of each row, shape (rows,); poses are in the order of their first rows.
        alone: whether nothing else was measured, so that some of it must train.
    Raises:
        InputError: no such column, a label that is not explained, a pose with two labels, or none to train with.
    """
    first: dict[object, int] = {}
    for i, key in enumerate(poses):
        first.setdefault(key, i)
    column = split.column or ("split" if "split" in table.columns else None)
    if column is None or split.test_fraction is not None:
        return ("train",) * len(first)
    if column not in table.columns:
        message = "there is no such column for the split"
        raise table.error(message, found=column, allowed=table.columns)
    cells = table.text(column)
    named = {**dict.fromkeys(split.train, "train"), **dict.fromkeys(split.test, "test")}
    out = []
    for i in first.values():
        if cells[i] not in named and split.column is None:
            message = "this label is neither 'train' nor 'test': say under 'data.split' which labels are which"
            raise table.error(message, row=i, column=column, found=cells[i], allowed=named)
        out.append(named.get(cells[i], "unused"))
    for row, key in enumerate(poses):
        if cells[row] != cells[first[key]]:
            message = f"this pose has another split in {table.said(first[key])}: a pose is held out as a whole"
            raise table.error(message, row=row, column=column, found=cells[row])
    if alone and "train" not in out:
        message = f"no pose is for training: none has the label {' or '.join(map(repr, split.train))}"
        raise table.error(message, column=column, found=", ".join(dict.fromkeys(cells)))
    return tuple(out)
