"""Images that are shown with what was found in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.vision.images import Image

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Example:
    """An image with what was found in it: points, shape (k, 2), px, and their names if they have any."""

    name: str
    image: Image
    pixels: Array
    labels: tuple[str, ...]
