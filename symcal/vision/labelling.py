"""Which blob is which disc: the assignment that fits the predicted image best, and how well the next best fits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_BASES = 10
_DECISIVE = 2.0


@dataclass(frozen=True, slots=True)
class Labelling:
    """An assignment of blobs to labels.

    Attributes:
        blobs: index of each label's blob, -1 where there is none; one per label.
        shift: mean displacement from the prediction, px.
        rms_px: of the displacements around that mean.
        next_rms_px: the same for the best other assignment of as many labels; inf if there is none.
    """

    blobs: tuple[int, ...]
    shift: tuple[float, float]
    rms_px: float
    next_rms_px: float

    @property
    def clear(self) -> bool:
        """Whether the prediction decides: the next assignment fits worse by a factor of two."""
        return self.next_rms_px >= _DECISIVE * self.rms_px

    @property
    def count(self) -> int:
        """How many labels have a blob."""
        return sum(blob >= 0 for blob in self.blobs)


def assign_labels(predicted: Float, found: Float, allowed: NDArray[np.bool_], search_px: float) -> Labelling | None:
    """Labels for blobs from predicted image points that may be shifted, and a little turned and stretched.

    Three labels are laid on every ordered triple of blobs of the same orientation (a face cannot be seen
    mirrored); the affine map between them carries the other labels to their nearest blobs. Assignments are ranked by
    the number of labels, then by the displacements from the prediction around their mean. Equal discs at the
    corners of an equilateral triangle leave it to the prediction alone, which decides only where the next assignment
    fits twice as badly.

    Args:
        predicted: image points of the labels, shape (n, 2), px.
        found: centres of the blobs, shape (m, 2), px.
        allowed: whether a label may take a blob, shape (n, m).
        search_px: largest mean displacement.
    Returns:
        None if no triple fits.
    """
    n, m = len(predicted), len(found)
    if n < 3 or m < 3:
        return None
    triples = np.array(list(permutations(range(m), 3)))
    ranked: dict[tuple[int, ...], tuple[float, tuple[float, float]]] = {}
    bases = sorted(combinations(range(n), 3), key=lambda base: -abs(_area(predicted[list(base)])))
    for base in bases[:_BASES]:
        labels = list(base)
        area = _area(predicted[labels])
        if abs(area) < 1e-9:
            break
        ok = allowed[labels, triples].all(axis=1) & (_area(found[triples]) / area > 0.25)
        for blobs in _extended(predicted, found, allowed, labels, triples[ok]):
            taken = blobs >= 0
            moved = found[blobs[taken]] - predicted[taken]
            shift = moved.mean(axis=0)
            if float(np.hypot(*shift)) <= search_px:
                rms = math.sqrt(float(np.mean(np.sum((moved - shift) ** 2, axis=1))))
                ranked[tuple(int(b) for b in blobs)] = rms, (float(shift[0]), float(shift[1]))
        if any(-1 not in blobs for blobs in ranked):
            break
    if not ranked:
        return None
    order = sorted(ranked, key=lambda blobs: (blobs.count(-1), ranked[blobs][0]))
    best, others = order[0], [b for b in order[1:] if b.count(-1) == order[0].count(-1)]
    rms, shift_px = ranked[best]
    return Labelling(best, shift_px, rms, ranked[others[0]][0] if others else math.inf)


def _area(corners: Float) -> Float:
    """Twice the signed area of triangles, (..., 3, 2) -> (...)."""
    a, b = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _extended(
    predicted: Float, found: Float, allowed: NDArray[np.bool_], labels: list[int], triples: NDArray[np.intp]
) -> NDArray[np.intp]:
    """Blobs of all labels, (k, n), given those of three; -1 where none is near, and without repeated blobs."""
    rest = [i for i in range(len(predicted)) if i not in labels]
    blobs = np.full((len(triples), len(predicted)), -1)
    blobs[:, labels] = triples
    if not rest or not len(triples):
        return blobs
    homogeneous = np.column_stack([predicted, np.ones(len(predicted))])
    weights = homogeneous[rest] @ np.linalg.inv(homogeneous[labels])
    placed = weights @ found[triples]
    distance = np.linalg.norm(placed[:, :, None] - found, axis=-1)
    distance = np.where(allowed[rest], distance, np.inf)
    spacing = np.linalg.norm(predicted[:, None] - predicted, axis=-1)
    gate = 0.3 * float(spacing[spacing > 0].min())
    nearest = distance.argmin(axis=2)
    blobs[:, rest] = np.where(distance.min(axis=2) < gate, nearest, -1)
    ordered = np.sort(blobs, axis=1)
    repeated = ((ordered[:, 1:] == ordered[:, :-1]) & (ordered[:, 1:] >= 0)).any(axis=1)
    return np.asarray(blobs[~repeated])
