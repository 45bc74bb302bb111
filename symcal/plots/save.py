"""Illustrations as files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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


def draw(drawings: Sequence[Drawing], folder: Path | str) -> tuple[Picture, ...]:
    """Draw figures and write them, into a folder that is made if there is none; two at a time where there are two cores
    (`symcal.outputs.side_by_side`).

    Raises:
        InputError: they cannot be written.
    """
    _make(folder)
    drawn = side_by_side([partial(_drawn, each, folder) for each in drawings])
    return _written([one for some in drawn for one in some])


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
    contents: dict[Path, str | bytes] = {}
    for (picture, vectors), png in zip(drawn, pixels([vectors for _, vectors in drawn]), strict=True):
        contents |= {picture.file: vectors, picture.file.with_name(f"{picture.file.stem}.png"): png}
    write_all_whole(contents)
    return tuple(picture for picture, _ in drawn)


def _make(folder: Path | str) -> None:
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder of figures cannot be made: {error.strerror}", file=folder) from None
