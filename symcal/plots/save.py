"""Illustrations as files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from io import BytesIO
from pathlib import Path

from matplotlib.backends.backend_pdf import FigureCanvasPdf

from symcal.errors import InputError
from symcal.outputs.names import file_name
from symcal.outputs.side_by_side import side_by_side
from symcal.outputs.whole_file import write_all_whole
from symcal.plots.pixels import pixels
from symcal.plots.style import Drawing, Illustration, print_settings
from symcal.report.render import Picture

_Drawn = tuple[Picture, bytes]
"""A picture whose file is still to be written, and what will be in it."""


def save_figure(illustration: Illustration, folder: Path | str, truetype: bool = False) -> Picture:
    """Write an illustration as PDF and PNG; the same figure gives the same bytes.

    Args:
        truetype: embed fonts as TrueType, as some journals ask; slower.
    Raises:
        InputError: the files cannot be written.
    """
    (picture,) = _written([_vectors(illustration, folder, truetype)])
    return picture


def save_figures(illustrations: Iterable[Illustration], folder: Path | str) -> tuple[Picture, ...]:
    """Write several, into a folder that is made if there is none.

    Raises:
        InputError: they cannot be written.
    """
    _make(folder)
    return _written([_vectors(illustration, folder) for illustration in illustrations])


def draw(
    drawings: Sequence[Drawing],
    folder: Path | str,
    report: Callable[[Sequence[Picture]], None] | None = None,
) -> tuple[Picture, ...]:
    """Draw figures and write them, into a folder that is made if there is none; two at a time where there are two cores
    (`symcal.outputs.side_by_side`).

    Args:
        report: what is made of the figures' PDF, in a thread of its own while others make their pixels: Typst, which
            makes both, lets go of the interpreter, and may not be called in a copy of this process.
    Raises:
        InputError: they cannot be written.
    """
    _make(folder)
    drawn = [one for some in side_by_side([partial(_drawn, each, folder) for each in drawings]) for one in some]
    write_all_whole({picture.file: vectors for picture, vectors in drawn})
    with ThreadPoolExecutor(1) as aside:
        written = None if report is None else aside.submit(report, [picture for picture, _ in drawn])
        write_all_whole(_with_pixels(drawn))
        if written is not None:
            written.result()
    return tuple(picture for picture, _ in drawn)


def _drawn(drawing: Drawing, folder: Path | str) -> tuple[_Drawn, ...]:
    return tuple(_vectors(illustration, folder) for illustration in drawing())


def _vectors(illustration: Illustration, folder: Path | str, truetype: bool = False) -> _Drawn:
    """Drawn once: `Figure.savefig` would draw it once more beforehand, for a layout that stands already."""
    vectors = BytesIO()
    with print_settings(truetype):
        FigureCanvasPdf(illustration.figure).print_pdf(vectors, metadata={"CreationDate": None})  # type: ignore[no-untyped-call]
    file = Path(folder) / f"{file_name(illustration.name)}.pdf"
    picture = Picture(file, illustration.name, illustration.width_mm, illustration.title, illustration.caption)
    return picture, vectors.getvalue()


def _written(drawn: Sequence[_Drawn]) -> tuple[Picture, ...]:
    """Files of vectors, and beside each its pixels."""
    write_all_whole({picture.file: vectors for picture, vectors in drawn} | _with_pixels(drawn))
    return tuple(picture for picture, _ in drawn)


def _with_pixels(drawn: Sequence[_Drawn]) -> dict[Path, str | bytes]:
    """The files of pixels that stand beside those of vectors."""
    files = [picture.file.with_name(f"{picture.file.stem}.png") for picture, _ in drawn]
    return dict(zip(files, pixels([vectors for _, vectors in drawn]), strict=True))


def _make(folder: Path | str) -> None:
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder of figures cannot be made: {error.strerror}", file=folder) from None
