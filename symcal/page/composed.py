"""A page from what it shows and its figures, within the bytes that it may have."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from symcal.outputs.side_by_side import side_by_side
from symcal.page.pictures import Embedded, embedded
from symcal.page.render import render
from symcal.report.render import Picture

CAP = 3_000_000
"""Bytes of a page without images; figures that go beyond are left out and named."""
CAP_WITH_IMAGES = 10_000_000


def composed(kind: str, shown: Callable[[], Mapping[str, Any]], pictures: Sequence[Picture]) -> str:
    """The page of a kind as HTML; what stands on it is made on two cores where there are two.

    Args:
        shown: makes what the template shows, but for the figures; its scene may have images.
    """
    work: list[Callable[[], Any]] = [shown, *(partial(embedded, each) for each in pictures)]
    given, *every = side_by_side(work)
    whole = render(kind, given | {"figures": every, "left_out": ()})
    excess = len(whole.encode()) - (CAP_WITH_IMAGES if given["scene"].get("images") else CAP)
    if excess <= 0:
        return whole
    kept = _without_last(every, excess)
    left_out = [each.title for each in every[len(kept) :]]
    return render(kind, given | {"figures": kept, "left_out": left_out})


def _without_last(every: Sequence[Embedded], excess: int) -> Sequence[Embedded]:
    """The figures without as many of the last as take up the bytes in excess, and those that name what is left out."""
    freed = np.cumsum([len(each.address) - 500 for each in reversed(every)])
    return every[: max(len(every) - 1 - int(np.searchsorted(freed, excess)), 0)]
