"""What a camera is calibrated with: a chessboard, a grid of circles or a ChArUco board."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError

Float = NDArray[np.float64]
BoardKind = Literal["chessboard", "circles", "asymmetric_circles", "charuco"]


@dataclass(frozen=True, slots=True)
class Board:
    """A printed calibration board.

    Attributes:
        kind: chessboard, circles, asymmetric_circles or charuco.
        columns, rows: as OpenCV counts: inner corners of a chessboard, circles of a grid, squares of a ChArUco board.
        square: side of a square, or spacing of the circles, mm (asymmetric: of the rows, half of that in a row).
        marker: side of a ChArUco marker, mm. dictionary: its name, such as DICT_4X4_50.
    """

    kind: BoardKind
    columns: int
    rows: int
    square: float
    marker: float | None = None
    dictionary: str | None = None

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 2 or (self.kind == "chessboard" and min(self.columns, self.rows) < 3):
            raise InputError("too few columns or rows", key="board", found=f"{self.columns}x{self.rows}")
        if not self.square > 0:
            raise InputError("the spacing must be positive", key="board", found=self.square)
        charuco = self.kind == "charuco"
        if charuco != (self.marker is not None) or charuco != (self.dictionary is not None):
            wanted = "a charuco board needs its marker size and dictionary, as in charuco:5x7:30mm:22mm:DICT_4X4_50"
            other = "marker size and dictionary belong to charuco boards, and to no other"
            raise InputError(wanted if charuco else other, key="board", found=self.kind)
        if self.marker is not None and not 0 < self.marker < self.square:
            raise InputError(
                "a marker must be smaller than its square", key="board", found=f"{self.marker} in {self.square}"
            )

    @property
    def points(self) -> Float:
        """Corners or circle centres in the board frame, row by row, z = 0; shape (n, 3), mm.

        The origin is the first point, but the board's outer corner for ChArUco (as in OpenCV); z points into the board.
        """
        first, columns, rows = (
            (1, self.columns - 1, self.rows - 1) if self.kind == "charuco" else (0, self.columns, self.rows)
        )
        row, column = np.divmod(np.arange(columns * rows), columns)
        x = 2 * column + row % 2 if self.kind == "asymmetric_circles" else column + first
        return np.stack([x, row + first, np.zeros_like(row)], axis=1) * float(self.square)

    def __str__(self) -> str:
        tail = "" if self.marker is None else f":{self.marker:g}mm:{self.dictionary}"
        return f"{self.kind}:{self.columns}x{self.rows}:{self.square:g}mm{tail}"


_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_BOARD = re.compile(
    r"(?P<kind>\w+):(?P<columns>\d+)x(?P<rows>\d+):(?P<square>[^:]+)(:(?P<marker>[^:]+):(?P<dictionary>\w+))?"
)


def parse_board(text: str) -> Board:
    """Board of a text such as chessboard:9x6:25mm, asymmetric_circles:4x11:2cm or charuco:5x7:30mm:22mm:DICT_4X4_50.

    Raises:
        InputError: not of this form, an unknown kind, or a length without its unit.
    """
    match = _BOARD.fullmatch(text.strip())
    if match is None:
        raise InputError("a board is kind:COLUMNSxROWS:SPACING, such as chessboard:9x6:25mm", key="board", found=text)
    kind = match["kind"]
    if kind not in get_args(BoardKind):
        raise InputError("unknown kind of board", key="board", found=kind, allowed=get_args(BoardKind))
    marker = None if match["marker"] is None else _length(match["marker"])
    size = int(match["columns"]), int(match["rows"])
    return Board(cast(BoardKind, kind), *size, _length(match["square"]), marker, match["dictionary"])


def _length(text: str) -> float:
    match = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)\s*(mm|cm|m)", text)
    if match is None:
        raise InputError("a length is a positive number with its unit, such as 25mm", key="board", found=text)
    return float(match[1]) * _MM[match[2]]
