"""Width and height of an image file from its first bytes, before anything of it is unpacked.

A file of a megabyte may stand for a picture of a gigabyte. OpenCV tells the size only with the pixels.

Source: PNG (ISO/IEC 15948), JPEG (ITU-T T.81, B.2.2), BMP (BITMAPINFOHEADER), TIFF 6.0 with BigTIFF, Netpbm's PGM and
PPM, WebP (RFC 9649).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable

Size = tuple[int, int]

FORMATS = "PNG, JPEG, BMP, TIFF, PGM, PPM or WebP"

# width, height and largest value behind P1..P6, with comments between
_GAP = rb"(?:\s|#[^\n]*\n)+"
_NETPBM = re.compile(rb"P[1-6]" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,9})\s")


def image_size(content: bytes) -> Size | None:
    """Width and height in px that the header announces; None if it is none of `FORMATS`, or breaks off."""
    for start, read in _READERS:
        if content.startswith(start):
            try:
                return read(content)
            except (struct.error, IndexError):
                return None
    return None


def _png(content: bytes) -> Size:
    width, height = struct.unpack_from(">II", content, 16)
    return width, height


def _bmp(content: bytes) -> Size:
    (header,) = struct.unpack_from("<I", content, 14)
    width, height = struct.unpack_from("<HH" if header == 12 else "<ii", content, 18)
    return abs(width), abs(height)


def _jpeg(content: bytes) -> Size | None:
    """The size stands in the frame header, behind any number of other segments."""
    at = 2
    while True:
        at = content.index(b"\xff", at) if b"\xff" in content[at : at + 2**16] else len(content)
        while content[at] == 0xFF:
            at += 1
        marker = content[at]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", content, at + 4)
            return width, height
        if marker == 0xDA:  # the scan begins
            return None
        at += (
            1 if marker in (0x00, 0x01) or 0xD0 <= marker <= 0xD8 else 1 + struct.unpack_from(">H", content, at + 1)[0]
        )


def _tiff(content: bytes) -> Size | None:
    order = "<" if content[:2] == b"II" else ">"
    big = struct.unpack_from(order + "H", content, 2)[0] == 43
    (first,) = struct.unpack_from(order + ("Q" if big else "I"), content, 8 if big else 4)
    (count,) = struct.unpack_from(order + ("Q" if big else "H"), content, first)
    found: dict[int, int] = {}
    for i in range(min(count, 4096)):
        at = first + (8 + 20 * i if big else 2 + 12 * i)
        tag, kind = struct.unpack_from(order + "HH", content, at)
        if tag in (256, 257):
            width = {3: "H", 4: "I", 16: "Q"}.get(kind)
            if width is None:
                return None
            found[tag] = struct.unpack_from(order + width, content, at + (12 if big else 8))[0]
    return (found[256], found[257]) if len(found) == 2 else None


def _netpbm(content: bytes) -> Size | None:
    match = _NETPBM.match(content[:4096])
    return None if match is None else (int(match[1]), int(match[2]))


def _webp(content: bytes) -> Size | None:
    if content[8:12] != b"WEBP":
        return None
    kind = content[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(content[24:27], "little"), 1 + int.from_bytes(content[27:30], "little")
    if kind == b"VP8L":
        bits = int.from_bytes(content[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", content, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None


_READERS: tuple[tuple[bytes, Callable[[bytes], Size | None]], ...] = (
    (b"\x89PNG\r\n\x1a\n", _png),
    (b"\xff\xd8\xff", _jpeg),
    (b"BM", _bmp),
    *((start, _tiff) for start in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")),
    *((start, _netpbm) for start in (b"P1", b"P2", b"P3", b"P4", b"P5", b"P6")),
    (b"RIFF", _webp),
)
