"""What a camera is calibrated with: a chessboard, a grid of circles, a ChArUco board or a grid of AprilTags."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError

Float = NDArray[np.float64]
BoardKind = Literal["chessboard", "circles", "asymmetric_circles", "charuco", "aprilgrid"]

_CHARUCO_DICTIONARIES = {50: "DICT_4X4_50", 100: "DICT_4X4_100", 250: "DICT_4X4_250", 1000: "DICT_4X4_1000"}
_APRIL_DICTIONARIES = ("DICT_APRILTAG_36h11", "DICT_APRILTAG_36h10", "DICT_APRILTAG_25h9", "DICT_APRILTAG_16h5")

_FORMS = {
    "chessboard": "chessboard:COLUMNSxROWS:SQUARE, such as chessboard:9x6:25mm (inner corners)",
    "circles": "circles:COLUMNSxROWS:SPACING, such as circles:9x7:20mm",
    "asymmetric_circles": "asymmetric_circles:COLUMNSxROWS:SPACING, such as asymmetric_circles:4x11:15mm",
    "charuco": "charuco:COLUMNSxROWS:SQUARE:MARKER[:DICTIONARY], such as charuco:12x9:30mm:22mm (a square, its marker)",
    "aprilgrid": "aprilgrid:COLUMNSxROWS:TAG:GAP[:DICTIONARY], such as aprilgrid:6x6:30mm:9mm (a tag, the gap)",
}


_MOST, _LARGEST_MM = 40_000, 10_000.0  # points and mm that no board has; ours


@dataclass(frozen=True, slots=True)
class Board:
    """A printed calibration board.

    Attributes:
        kind: chessboard, circles, asymmetric_circles, charuco or aprilgrid.
        columns, rows: as OpenCV counts: inner corners of a chessboard, circles of a grid, squares of a ChArUco board;
            tags of an AprilTag grid.
        square: side of a square, or spacing of the circles, mm (asymmetric: of the rows, half of that in a row); side
            of a tag.
        marker: side of a ChArUco marker, mm. dictionary: of the markers or tags, such as DICT_4X4_50.
        gap: between the tags of a grid, mm.

    Example:
        >>> import symcal as sc
        >>> str(sc.Board("chessboard", columns=9, rows=6, square=25.0))
        'chessboard:9x6:25mm'
    """

    kind: BoardKind
    columns: int
    rows: int
    square: float
    marker: float | None = None
    dictionary: str | None = None
    gap: float | None = None

    def __post_init__(self) -> None:
        least = {"chessboard": 3, "aprilgrid": 1}.get(self.kind, 2)
        if min(self.columns, self.rows) < least:
            raise InputError("too few columns or rows", key="board", found=f"{self.columns}x{self.rows}")
        if self.columns * self.rows > _MOST:
            raise InputError(f"more than {_MOST} squares or circles", key="board", found=f"{self.columns}x{self.rows}")
        if not 0 < self.square <= _LARGEST_MM:
            problem = "positive" if not self.square > 0 else "10 m at most"
            raise InputError(f"the spacing must be {problem}", key="board", found=self.square)
        charuco, aprilgrid = self.kind == "charuco", self.kind == "aprilgrid"
        if charuco != (self.marker is not None) or (charuco or aprilgrid) != (self.dictionary is not None):
            wanted = f"a board with markers needs their size and dictionary: {_FORMS.get(self.kind, '')}"
            other = "marker size and dictionary belong to boards with markers, and to no other"
            raise InputError(wanted if charuco or aprilgrid else other, key="board", found=self.kind)
        if self.marker is not None and not 0 < self.marker < self.square:
            raise InputError(
                "a marker must be smaller than its square", key="board", found=f"{self.marker} in {self.square}"
            )
        if aprilgrid != (self.gap is not None):
            raise InputError("the gap between tags belongs to an AprilTag grid", key="board", found=self.kind)
        if self.gap is not None and not 0 < self.gap <= self.square:
            message = "the gap between tags must be positive and no larger than a tag"
            raise InputError(message, key="board", found=f"{self.gap} beside {self.square}")
        if aprilgrid and self.dictionary not in _APRIL_DICTIONARIES:
            raise InputError("not a family of tags", key="board", found=self.dictionary, allowed=_APRIL_DICTIONARIES)

    @property
    def points(self) -> Float:
        """Corners or circle centres in the board frame, row by row, z = 0; shape (n, 3), mm.

        The origin is the first point, but the board's outer corner for ChArUco (as in OpenCV); x to the right, y down
        and z into the board. An AprilTag grid is Kalibr's: tags are numbered from the lower left, x to the right, y up
        and z out of the board; its points are the tags' corners, row by row from the lower left of tag 0.
        """
        if self.gap is not None:
            row, column = np.divmod(np.arange(4 * self.columns * self.rows), 2 * self.columns)
            x, y = (half // 2 * (self.square + self.gap) + half % 2 * self.square for half in (column, row))
            return np.stack([x, y, np.zeros_like(x)], axis=1)
        first, columns, rows = (
            (1, self.columns - 1, self.rows - 1) if self.kind == "charuco" else (0, self.columns, self.rows)
        )
        row, column = np.divmod(np.arange(columns * rows), columns)
        x = 2 * column + row % 2 if self.kind == "asymmetric_circles" else column + first
        return np.stack([x, row + first, np.zeros_like(row)], axis=1) * float(self.square)

    @property
    def facing(self) -> int:
        """+1 if the printed face looks along the board's +z, -1 if along -z."""
        return 1 if self.kind == "aprilgrid" else -1

    @property
    def normal(self) -> tuple[float, float, float]:
        """Unit vector out of the printed face, in the board's frame."""
        return (0.0, 0.0, float(self.facing))

    def __str__(self) -> str:
        extra = self.marker if self.gap is None else self.gap
        tail = "" if extra is None else f":{extra:.12g}mm:{self.dictionary}"
        return f"{self.kind}:{self.columns}x{self.rows}:{self.square:.12g}mm{tail}"


_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}


def parse_board(text: str) -> Board:
    """Board of a text such as chessboard:9x6:25mm, asymmetric_circles:4x11:2cm, charuco:5x7:30mm:22mm:DICT_4X4_50 or
    aprilgrid:6x6:30mm:9mm.

    Without a dictionary a ChArUco board has the smallest of DICT_4X4_50, .. _1000 that has enough markers, and a grid
    of tags DICT_APRILTAG_36h11; `str` of the board writes it out.

    Raises:
        InputError: not of this form, an unknown kind, or a length without its unit.

    Example:
        >>> import symcal as sc
        >>> board = sc.parse_board("charuco:12x9:30mm:22mm")
        >>> board.columns, board.rows, board.square, board.dictionary
        (12, 9, 30.0, 'DICT_4X4_100')
    """
    kind, _, rest = text.strip().partition(":")
    if kind not in get_args(BoardKind):
        if not rest:
            message = "a board is kind:COLUMNSxROWS:SPACING, such as chessboard:9x6:25mm"
            raise InputError(message, key="board", found=text)
        raise InputError("unknown kind of board", key="board", found=kind, allowed=get_args(BoardKind))
    size, *details = rest.split(":")
    counts = re.fullmatch(r"([0-9]{1,6})x([0-9]{1,6})", size)
    lengths = 2 if kind in ("charuco", "aprilgrid") else 1
    if lengths == 1 and len(details) > 1:
        message = "marker size and dictionary belong to charuco boards, tags and gaps to an aprilgrid, and to no other"
        raise InputError(message, key="board", found=text)
    if counts is None or not lengths <= len(details) <= 2 * lengths - 1 or not all(details):
        raise InputError(f"a board is {_FORMS[kind]}", key="board", found=text)
    columns, rows = int(counts[1]), int(counts[2])
    square = _length(details[0])
    second = _length(details[1]) if lengths == 2 else None
    dictionary = details[2] if len(details) > 2 else None
    if kind == "aprilgrid":
        name = dictionary or _APRIL_DICTIONARIES[0]
        return Board("aprilgrid", columns, rows, square, dictionary=name, gap=second)
    if kind == "charuco" and dictionary is None:
        dictionary = _smallest_dictionary(columns, rows)
    return Board(cast(BoardKind, kind), columns, rows, square, second, dictionary)


def _smallest_dictionary(columns: int, rows: int) -> str:
    needed = columns * rows // 2  # every white square holds one
    for markers, name in _CHARUCO_DICTIONARIES.items():
        if needed <= markers:
            return name
    message = f"this board needs {needed} markers, more than any dictionary of 4 x 4 bits has"
    raise InputError(message, key="board", found=f"{columns}x{rows}")


def _length(text: str) -> float:
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*(mm|cm|m)", text)
    if match is None:
        raise InputError("a length is a positive number with its unit, such as 25mm", key="board", found=text)
    return float(match[1]) * _MM[match[2]]
