"""What a camera saw at the poses of a page: a small image of each, as far as there is room."""

from __future__ import annotations

import base64
from dataclasses import dataclass, replace
from html import escape

from symcal.data.dataset import evenly

_AROUND = 260
"""Bytes of a page that an image takes beside its own and the names that it bears."""
_HEAD = 1500
"""Bytes of the section that the images are in."""


@dataclass(frozen=True, slots=True)
class Thumbnail:
    """A small image of a pose. by: the instrument that saw it, where several did. jpeg: the file."""

    label: str
    by: str
    jpeg: bytes

    @property
    def address(self) -> str:
        return f"data:image/jpeg;base64,{base64.b64encode(self.jpeg).decode('ascii')}"

    @property
    def bytes_on_page(self) -> int:
        """No fewer than it takes as HTML."""
        names = 3 * len(escape(self.label).encode()) + len(escape(self.by).encode())
        return 4 * (len(self.jpeg) // 3 + 1) + names + _AROUND


@dataclass(frozen=True, slots=True)
class Gallery:
    """Images in the order of their poses. of: how many were measured, before some were left out."""

    thumbnails: tuple[Thumbnail, ...] = ()
    of: int = 0


NONE = Gallery()


def fitting(images: Gallery, room: int) -> Gallery:
    """As many of the images as go into so many bytes, evenly among them."""
    sizes, room = [each.bytes_on_page for each in images.thumbnails], max(room - _HEAD, 0)
    chosen = evenly(len(sizes), len(sizes))
    while (taken := sum(sizes[i] for i in chosen)) > room:
        chosen = evenly(len(sizes), min(len(chosen) - 1, len(chosen) * room // taken))
    return replace(images, thumbnails=tuple(images.thumbnails[i] for i in chosen))
