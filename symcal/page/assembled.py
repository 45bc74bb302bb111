"""A page with as many of its figures and images as it has room for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from symcal.outputs.side_by_side import side_by_side
from symcal.page.gallery import NONE, Gallery, fitting
from symcal.page.pictures import Embedded, embedded
from symcal.page.render import render
from symcal.report.render import Picture

CAP = 3_000_000
"""Bytes of a page without images; figures that go beyond are left out and named."""
CAP_WITH_IMAGES = 10_000_000
"""Bytes of a page with images; these have what figures leave, and it is said how many there are of how many."""


def assembled(
    kind: str, given: Callable[[], Mapping[str, Any]], pictures: Sequence[Picture], images: Gallery = NONE
) -> str:
    """The page of a kind as HTML; what stands on it is made on two cores where there are two.

    Args:
        given: what the template shows, but for the figures. pictures: the figures. images: of poses.
    """
    work: list[Callable[[], Any]] = [given, *(partial(embedded, each) for each in pictures)]
    shown, *every = side_by_side(work)
    bare = dict(shown) | {"gallery": NONE, "cap_mb": CAP_WITH_IMAGES // 1_000_000}
    cap = CAP_WITH_IMAGES if images.thumbnails else CAP
    whole = render(kind, bare | {"figures": every, "left_out": ()})
    kept: Sequence[Embedded] = every
    if len(whole.encode()) > cap:
        kept = _without_last(every, len(whole.encode()) - cap)
    figures = {"figures": kept, "left_out": [each.title for each in every[len(kept) :]]}
    if images.thumbnails:
        room = cap - len(render(kind, bare | figures).encode())
        return render(kind, bare | figures | {"gallery": fitting(images, room)})
    return whole if len(kept) == len(every) else render(kind, bare | figures)


def _without_last(every: Sequence[Embedded], excess: int) -> Sequence[Embedded]:
    """The figures without as many of the last as take up the bytes in excess, and those that name what is left out."""
    freed = np.cumsum([len(each.address) - 500 for each in reversed(every)])
    return every[: max(len(every) - 1 - int(np.searchsorted(freed, excess)), 0)]
