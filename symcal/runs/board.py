"""`symcal board`: a board's text in, a PDF to print out."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

from symcal.camera.board import Board
from symcal.errors import InputError
from symcal.plots.board import BoardSheet, board_sheet
from symcal.plots.style import print_settings


def print_board(board: Board, out: Path, page: str | None = None) -> BoardSheet:
    """Write a board as PDF at true size, as `board_sheet` draws it; the same board gives the same bytes.

    Raises:
        InputError: no page holds the board, its markers cannot be had, or the file cannot be written.
    """
    sheet = board_sheet(board, page)
    content = BytesIO()
    with print_settings():
        sheet.figure.savefig(content, format="pdf", metadata={"Title": str(board), "CreationDate": None})
    try:
        out.write_bytes(content.getvalue())
    except OSError as error:
        raise InputError(f"the board cannot be written: {error.strerror}", file=out) from None
    return sheet
