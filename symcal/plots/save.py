"""Illustrations as files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from io import BytesIO
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf

from symcal.errors import InputError
from symcal.outputs.names import file_name
from symcal.outputs.side_by_side import side_by_side
from symcal.outputs.whole_file import write_all_whole
from symcal.plots.style import PIXELS_PER_INCH, Drawing, Illustration, hold_labels, print_settings
from symcal.report.render import Picture

_LEVEL = 3  # of 9: half the time of the usual 6, files a few hundredths larger


def save_figure(illustration: Illustration, folder: Path | str, truetype: bool = False) -> Picture:
    """Write an illustration as PDF and PNG; the same figure gives the same bytes.

    Drawn once for each: `Figure.savefig` would draw everything once more beforehand, for a layout that stands already.

    Args:
        truetype: embed fonts as TrueType, as some journals ask; slower.
    Raises:
        InputError: the files cannot be written.
    """
    target = Path(folder) / f"{file_name(illustration.name)}.pdf"
    vectors, pixels = BytesIO(), BytesIO()
    with print_settings(truetype):
        figure = illustration.figure
        figure.dpi = PIXELS_PER_INCH
        canvas = figure.canvas if isinstance(figure.canvas, FigureCanvasAgg) else FigureCanvasAgg(figure)
        canvas.print_png(pixels, pil_kwargs={"compress_level": _LEVEL})  # type: ignore[no-untyped-call]
        hold_labels(figure)
        FigureCanvasPdf(figure).print_pdf(vectors, metadata={"CreationDate": None})  # type: ignore[no-untyped-call]
    write_all_whole({target: vectors.getvalue(), target.parent / f"{target.stem}.png": pixels.getvalue()})
    return Picture(target, illustration.name, illustration.width_mm, illustration.title, illustration.caption)


def save_figures(illustrations: Iterable[Illustration], folder: Path | str) -> tuple[Picture, ...]:
    """Write several, into a folder that is made if there is none.

    Raises:
        InputError: they cannot be written.
    """
    _make(folder)
    return tuple(save_figure(illustration, folder) for illustration in illustrations)


def draw(drawings: Sequence[Drawing], folder: Path | str) -> tuple[Picture, ...]:
    """Draw figures and write them, into a folder that is made if there is none; two at a time where there are two cores
    (`symcal.outputs.side_by_side`).

    Raises:
        InputError: they cannot be written.
    """
    _make(folder)
    pictures = side_by_side([partial(_drawn, each, folder) for each in drawings])
    return tuple(picture for some in pictures for picture in some)


def _drawn(drawing: Drawing, folder: Path | str) -> tuple[Picture, ...]:
    return tuple(save_figure(illustration, folder) for illustration in drawing())


def _make(folder: Path | str) -> None:
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder of figures cannot be made: {error.strerror}", file=folder) from None
