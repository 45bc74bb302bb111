"""Grey images from files, with a name for everything that can be wrong with one."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from symcal.documents.read import MB, read_bytes
from symcal.errors import InputError
from symcal.outputs.whole_file import write_whole
from symcal.vision.image_size import FORMATS, image_size

Image = NDArray[np.uint8]

BLACK_LEVEL = 16
"""An image whose brightest pixels (99.9th percentile) stay below this grey level of 255 is called black. Ours."""


LARGEST = 160_000_000
"""Pixels of an image: the largest sensors have 151 million. Ours."""

THUMBNAIL = 320
"""Pixels of the longer side of a small copy: as wide as a page shows one."""

_QUALITY = 70  # of 100; the graininess of an image is most of a file of more
_FILE_LIMIT = 512 * MB


def read_image(path: Path | str) -> Image:
    """An image file as 8-bit grey levels, shape (height, width), in the sensor's own orientation.

    Colour becomes grey; 16 bits are scaled by the power of two that just holds the brightest pixel (10, 12 or 14 bits
    stored in 16). EXIF orientation is ignored: it would turn single images of one camera.

    Raises:
        InputError: no such file, not an image, more than `LARGEST` pixels, or a file that breaks off before its end.
    """
    path = Path(path)
    content = read_bytes(path, _FILE_LIMIT, "image")
    if _cut(content):
        raise InputError("the image is cut: the file breaks off before its end", file=path)
    size = image_size(content)
    if size is None:
        raise InputError(f"not an image that can be read: {FORMATS} is needed", file=path)
    if size[0] * size[1] > LARGEST:
        message = f"the image is too large: at most {LARGEST // 10**6} million pixels are read"
        raise InputError(message, file=path, found=f"{size[0]} x {size[1]}")
    data = np.frombuffer(content, dtype=np.uint8)
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(data, flags)
    except cv2.error:
        image = None
    if image is None:
        raise InputError("not an image that can be read", file=path)
    if image.dtype == np.uint8:
        return np.asarray(image, dtype=np.uint8)
    brightest = float(image.max())
    if not np.isfinite(brightest + float(image.min())):
        raise InputError("the image has pixels that are no finite number", file=path)
    full = 2.0 ** np.ceil(np.log2(max(brightest, 255.0) + 1)) if image.dtype == np.uint16 else brightest
    grey = np.empty(image.shape, dtype=np.uint8)
    for i, row in enumerate(image):  # by rows: as floats the whole would take eight times its memory
        grey[i] = np.rint(np.clip(row * (255.0 / max(full, 1e-9)), 0, 255))
    return grey


def is_black(image: Image) -> bool:
    """Whether nothing in the image is brighter than `BLACK_LEVEL`."""
    return bool(np.percentile(image, 99.9) < BLACK_LEVEL)


def _cut(content: bytes) -> bool:
    """Whether a JPEG or PNG lacks its end mark (the decoder would fill up with grey and go on)."""
    if content.startswith(b"\xff\xd8\xff"):
        scan = content.rfind(b"\xff\xda")
        return scan < 0 or content.find(b"\xff\xd9", scan) < 0
    return content.startswith(b"\x89PNG\r\n\x1a\n") and b"IEND" not in content[-64:]


def thumbnail(image: NDArray[np.generic]) -> bytes:
    """A small copy of an image as JPEG, its longer side at most `THUMBNAIL` pixels; some ten thousand bytes."""
    grey = np.asarray(image, dtype=np.uint8)
    scale = min(THUMBNAIL / max(grey.shape[:2]), 1.0)
    size = (max(round(grey.shape[1] * scale), 1), max(round(grey.shape[0] * scale), 1))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", small, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))[1].tobytes())


def write_image(path: Path | str, image: Image) -> None:
    """Write grey levels as PNG.

    Raises:
        InputError: the file cannot be written.
    """
    done, content = cv2.imencode(".png", image)
    if not done:
        raise InputError("the image cannot be encoded", file=path)
    write_whole(path, content.tobytes())
