"""`symcal board`: a board's text in, a PDF to print out."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

from symcal.camera.board import Board
from symcal.outputs.whole_file import write_whole
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
    write_whole(out, content.getvalue())
    return sheet
