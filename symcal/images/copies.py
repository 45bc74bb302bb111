"""Images that are copies of one another under several names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symcal.images.shots import Shot
from symcal.vision.board import BoardDetection

Array = NDArray[np.float64]

_ALIKE_PX = 0.01  # no camera gives a scene twice with corners this close
_SAME = 1e-6  # rad and mm of joint readings


def copies(detections: Sequence[BoardDetection], digests: Sequence[str]) -> list[list[int]]:
    """Groups of views that are one image: the same grey levels, or the same corners within a hundredth of a pixel."""
    groups: list[list[int]] = []
    for i, (detection, digest) in enumerate(zip(detections, digests, strict=True)):
        for group in groups:
            first = group[0]
            if digest == digests[first] or _alike(detection, detections[first]):
                group.append(i)
                break
        else:
            groups.append([i])
    return [group for group in groups if len(group) > 1]


def _alike(a: BoardDetection, b: BoardDetection) -> bool:
    return np.array_equal(a.indices, b.indices) and bool(np.abs(a.pixels - b.pixels).max() < _ALIKE_PX)


def copy_reasons(
    groups: Sequence[Sequence[int]], shots: Sequence[Shot], misfit: Array | None
) -> tuple[dict[int, str], list[str]]:
    """The reason of every view that is left out as a copy, and a sentence for each group.

    Of a group the one stays that fits its joint readings best; if nobody knows which that is, the first where all have
    the same readings, and none where they differ.

    Args:
        misfit: of each view at its own joint readings, shape (N,), mm; None if it is not known.
    """
    reasons: dict[int, str] = {}
    notes: list[str] = []
    for group in groups:
        names = [shots[i].name for i in group]
        notes.append(f"{' and '.join(names) if len(names) == 2 else ', '.join(names)} are one image")
        alike = all(np.abs(shots[i].q - shots[group[0]].q).max() < _SAME for i in group)
        best = min(group, key=lambda i: misfit[i]) if misfit is not None and not alike else group[0]
        kept = best if alike or misfit is not None else None
        for i in group:
            if i == kept:
                continue
            other = shots[kept if kept is not None else next(j for j in group if j != i)].name
            doubt = "" if kept is not None else ", and their joint readings differ"
            reasons[i] = f"it is a copy of {other}{doubt}"
    return reasons, notes
