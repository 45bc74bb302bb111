"""Figures inside the page: as PNG, with as few colours as they need."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from io import BytesIO

import numpy as np

from symcal.report.render import Picture

_COLORS = 128


@dataclass(frozen=True, slots=True)
class Embedded:
    """A picture as `data:` address."""

    name: str
    title: str
    caption: str
    address: str


def embedded(picture: Picture) -> Embedded:
    """A figure of a report, from the PNG beside its PDF."""
    from PIL import Image

    with Image.open(picture.file.with_suffix(".png")) as image:
        every = image.convert("RGB")
    # six times as fast as the median cut and nearer to the colours of few pixels, but it greys the white paper:
    few = every.quantize(_COLORS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    colors = np.reshape(few.getpalette() or [], (-1, 3))
    colors[np.asarray(few)[0, 0]] = np.asarray(every)[0, 0]
    few.putpalette(colors.ravel().tolist())
    stream = BytesIO()
    few.save(stream, "PNG")
    return Embedded(picture.name, picture.title, picture.caption, _address(stream))


def _address(stream: BytesIO) -> str:
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"
