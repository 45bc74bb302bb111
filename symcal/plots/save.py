"""Illustrations as files."""

from __future__ import annotations

from collections.abc import Iterable
from io import BytesIO
from pathlib import Path

from symcal.errors import InputError
from symcal.outputs.names import file_name
from symcal.outputs.whole_file import write_all_whole
from symcal.plots import Illustration, print_settings
from symcal.report.render import Picture

PIXELS_PER_INCH = 150


def save_figure(illustration: Illustration, folder: Path | str, truetype: bool = False) -> Picture:
    """Write an illustration as PDF and PNG; the same figure gives the same bytes.

    Args:
        truetype: embed fonts as TrueType, as some journals ask; slower.
    Raises:
        InputError: the files cannot be written.
    """
    target = Path(folder) / f"{file_name(illustration.name)}.pdf"
    vectors, pixels = BytesIO(), BytesIO()
    with print_settings(truetype):
        illustration.figure.savefig(vectors, format="pdf", metadata={"CreationDate": None})
        illustration.figure.savefig(pixels, format="png", dpi=PIXELS_PER_INCH)
    write_all_whole({target: vectors.getvalue(), target.parent / f"{target.stem}.png": pixels.getvalue()})
    return Picture(target, illustration.name, illustration.width_mm, illustration.title, illustration.caption)


def save_figures(illustrations: Iterable[Illustration], folder: Path | str) -> tuple[Picture, ...]:
    """Write several, into a folder that is made if there is none.

    Raises:
        InputError: they cannot be written.
    """
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder of figures cannot be made: {error.strerror}", file=folder) from None
    return tuple(save_figure(illustration, folder) for illustration in illustrations)
