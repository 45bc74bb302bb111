"""Named reasons why an image of a disc target gives no measurement."""

from __future__ import annotations

from enum import StrEnum

from symcal.errors import RefusedError


class Failure(StrEnum):
    """Why an image, or one disc in it, gave no image point."""

    WRONG_IMAGE = "not a grey image of 8 or 16 bits"
    WRONG_SIZE = "wrong image size"
    BLACK = "black image"
    BACK_SIDE = "back side visible"
    TOO_SMALL = "seen too flat or from too far away"
    OUTSIDE = "out of the image"
    CUT = "cut by the image border"
    LOW_CONTRAST = "low contrast"
    BLURRED = "blurred"
    NO_DISCS = "no discs found"
    TOO_FEW = "too few discs found"
    HIDDEN = "partly hidden, or no disc"
    AMBIGUOUS = "ambiguous labels"


class NotDetected(RefusedError):
    """An image without a usable target, or a disc without an image point.

    Attributes:
        failure: the reason.
        detail: the numbers behind it.
        disc: the name of the disc concerned; None if it is the whole image.
    """

    def __init__(self, failure: Failure, detail: str, disc: str | None = None) -> None:
        self.failure, self.detail, self.disc = failure, detail, disc
        super().__init__(f"{failure}: {'' if disc is None else f'disc {disc} '}{detail}")
