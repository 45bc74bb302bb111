"""A board on a page at true size, with a bar to measure and its own text below."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from symcal.camera.board import Board
from symcal.errors import InputError
from symcal.plots.style import print_settings
from symcal.vision.printed import Artwork, artwork

PAGES = {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "A2": (420.0, 594.0), "A1": (594.0, 841.0), "A0": (841.0, 1189.0)}
"""Width and height, mm; from the smallest to the largest, upright."""
EXACT = "exact"

_QUIET = (0.25, 5.0, 15.0)  # white around the pattern at least: share of a square, within these mm; the page adds more
_BAR, _EDGE, _CAPTION = 100.0, 5.0, 10.5  # length of the bar, white at the page's edge, height of the caption; mm
_LARGEST = 5000.0  # mm; a PDF page has no more than 14400 points


@dataclass(frozen=True, slots=True)
class BoardSheet:
    """A page with a board: its name, its size in mm, and where the upper left of the pattern is, mm from the page's."""

    figure: Figure
    page: str
    width: float
    height: float
    left: float
    top: float


def board_sheet(board: Board, page: str | None = None) -> BoardSheet:
    """Draw a board at true size.

    Args:
        page: one of `PAGES`, upright or across; "exact": as large as the board needs; None: the smallest that holds it.
    Raises:
        InputError: no such page, or one (or all of them) too small for the board.
    """
    art = artwork(board)
    share, low, high = _QUIET
    quiet = float(np.clip(share * board.square, low, high))
    needed = max(art.width + 2 * quiet, _BAR + 2 * _EDGE), art.height + 2 * quiet + _CAPTION
    name, (width, height) = _page(needed, page)
    left, top = (width - art.width) / 2, (height - _CAPTION - art.height) / 2
    with print_settings():
        figure = Figure(figsize=(width / 25.4, height / 25.4))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(0, width)
        axes.set_ylim(height, 0)
        axes.add_patch(_ink(art, left, top))
        at, below = (width - max(art.width, _BAR)) / 2, height - _CAPTION
        bar = np.array([(0.0, 0.7, _BAR, 0.5), (0.0, 0.0, 0.25, 1.9), (_BAR - 0.25, 0.0, 0.25, 1.9)])
        axes.add_patch(_ink(Artwork(_BAR, 1.9, bar, np.empty((0, 3)), np.empty((0, 2))), at, below))
        text = f"measure me: 100 mm; print at 100 %; {board}"
        axes.text(at, below + 3.7, text, fontsize=6, va="center", parse_math=False)
    return BoardSheet(figure, name, width, height, left, top)


def _page(needed: tuple[float, float], page: str | None) -> tuple[str, tuple[float, float]]:
    wanted = f"{needed[0]:.0f} x {needed[1]:.0f} mm with its white border and caption"
    if page == EXACT:
        if max(needed) > _LARGEST:
            raise InputError(f"the board is too large for a PDF page: it needs {wanted}", key="--page", found=page)
        return EXACT, needed
    if page is not None and page not in PAGES:
        raise InputError("no such page", key="--page", found=page, allowed=(*PAGES, EXACT))
    fitting = [
        (name, size)
        for name, upright in PAGES.items()
        for size in (upright, upright[::-1])
        if needed[0] <= size[0] and needed[1] <= size[1]
    ]
    chosen = [each for each in fitting if page in (None, each[0])]
    if chosen:
        return chosen[0]
    if fitting:
        raise InputError(f"the board needs {wanted}: {fitting[0][0]} holds it", key="--page", found=page)
    message = f"no page up to A0 holds the board, which needs {wanted}: make it smaller, or say --page exact"
    raise InputError(message, key="--page", found=page)


def _ink(art: Artwork, left: float, top: float) -> PathPatch:
    """All shapes as one path, so that shapes that touch show no seam."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY]
    shapes = [Path(place[:2] + corners * place[2:] + [left, top], codes) for place in art.rectangles]
    shapes += [Path.circle((x + left, y + top), radius) for x, y, radius in art.discs]
    return PathPatch(Path.make_compound_path(*shapes), facecolor="black", edgecolor="none", linewidth=0)
