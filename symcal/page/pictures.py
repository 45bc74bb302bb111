"""Figures and images inside the page: as PNG, with as few colours as they need."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.report.render import Picture

_COLORS = 128
_THUMBNAIL = 480  # px, the longer side
_QUALITY = 75


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
    return Embedded(picture.name, picture.title, picture.caption, _address("png", stream))


def thumbnail(pixels: NDArray[Any]) -> str:
    """The address of a small copy of a grey or colour image."""
    from PIL import Image

    step = max(1, max(pixels.shape[:2]) // (2 * _THUMBNAIL))
    image = Image.fromarray(np.ascontiguousarray(pixels[::step, ::step]))
    image.thumbnail((_THUMBNAIL, _THUMBNAIL))
    stream = BytesIO()
    image.save(stream, "JPEG", quality=_QUALITY)
    return _address("jpeg", stream)


def _address(kind: str, stream: BytesIO) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"
