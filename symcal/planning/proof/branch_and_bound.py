r"""The largest value of a `TracePolynomial` over its working area: a proven bound, by branch and bound.

A box is bounded by its largest convex coefficient (`symcal.planning.proof.bernstein`), and is done with where that is
below the threshold, or where the polynomial rises or falls strictly along a joint: then its largest value lies on a
face, which is looked at alone if it is at a limit of the area, and else belongs to another box. What is left is halved
along the joint with the largest second difference. A value at a corner of a box that exceeds what a search found lifts
the threshold: the search had missed it.

Why a face inside the area need not be looked at: the derivative along the joint is not zero on the whole closed box, so
no point of it is a largest value of the area, not even on that face.

Constraints are left out: they only take poses away, so that the bound may be loose and is never wrong.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symcal.planning.proof.trace_polynomial import Axis, TracePolynomial, apply

Array = NDArray[np.float64]

WORK = 2_000_000_000
"""Coefficients that are looked at before the rest is left open: some 30 s. Not time, so that results repeat."""

_PER_BOX = 10_000  # coefficients that could be looked at in the time that every box takes beside its own

_ROUNDS = 2  # pieces whose quota was used up are tried again with what all others left
_DEEPEST = 40  # halvings of a joint: beyond it, intervals are as narrow as rounding


@dataclass(frozen=True, slots=True)
class Bound:
    """The largest value of a polynomial over its working area.

    upper: proven; rounding is in it. value, pose: the largest value that was met, and where, shape (dof,); both None
    where it is no larger than was to be proven: else the search had missed it. open_share: of the area's volume, that
    is not proven to lie below what was to be proven. boxes: that were looked at, pieces of the joints' ranges among
    them. rounding: the margin for it.
    """

    upper: float
    value: float | None
    pose: Array | None
    open_share: float
    boxes: int
    rounding: float


@dataclass(frozen=True, slots=True)
class _Box:
    """Coefficients over a box. Per axis: the piece, how often it was halved, which of the parts this is, and the face
    it was collapsed to: -1 the lower, 1 the upper, 0 none."""

    coefficients: Array
    piece: tuple[int, ...]
    level: tuple[int, ...]
    part: tuple[int, ...]
    face: tuple[int, ...]


@dataclass(slots=True)
class _Search:
    """What is known so far.

    changes: to coefficients, by axis and piece. halvings: by axis and level. missed: values above it are worth telling.
    """

    polynomial: TracePolynomial
    changes: list[list[Array]]
    slack: float
    rounding: float
    threshold: float
    missed: float
    work: int = 0
    boxes: int = 0
    value: float | None = None
    pose: Array | None = None
    halvings: dict[tuple[int, int], Array] = field(default_factory=dict)

    def look(self, start: _Box, quota: int) -> tuple[float, float]:
        """Depth first, from a piece, until nothing is open or the quota of work is used up.

        Returns:
            bound of what is left open (minus infinity if nothing is), and its share of the piece.
        """
        stack, begun = [start], self.work
        upper, open_share = -np.inf, 0.0
        while stack:
            box = stack.pop()
            top = float(box.coefficients.max())
            if top + self.rounding <= self.threshold:
                continue
            axis = None
            if self.work - begun < quota:
                self.work += box.coefficients.size + _PER_BOX
                self.boxes += 1
                self._corners(box)
                folded = self._fold(box)
                if folded is None:
                    continue
                if folded is not box:
                    stack.append(folded)
                    continue
                axis = self._split(box)
            if axis is None:
                upper = max(upper, top + self.rounding)
                open_share += 2.0 ** -sum(box.level)
            else:
                stack.extend(self._halves(box, axis))
        return upper, open_share

    def _corners(self, box: _Box) -> None:
        """Corners are values of the polynomial: a large one lifts the threshold."""
        corners = _corners(box.coefficients)
        best = float(corners.max())
        if best + self.slack > self.threshold:
            self.threshold = best + self.slack
        if best > self.missed:
            self.missed = self.value = best
            self.pose = self._place(box, np.unravel_index(int(np.argmax(corners)), corners.shape))

    def _place(self, box: _Box, side: tuple[np.intp, ...]) -> Array:
        area = self.polynomial.area
        pose = 0.5 * (area.lower + area.upper)
        for i, axis in enumerate(self.polynomial.axes):
            up = box.face[i] > 0 if box.face[i] else bool(side[i])
            low, high = axis.ends[box.piece[i] : box.piece[i] + 2]
            pose[axis.joint] = low + (high - low) * (box.part[i] + up) / 2 ** box.level[i]
        return pose

    def _fold(self, box: _Box) -> _Box | None:
        """The box, or its face where the polynomial is largest, or None if that is not to be looked at."""
        corners = _corners(box.coefficients)
        for i, axis in enumerate(self.polynomial.axes):
            n = box.coefficients.shape[i]
            if n == 1:
                continue
            tried = _steps(corners, i)  # most axes are ruled out by their edges
            rises, falls = bool(tried.min() > 2 * self.rounding), bool(tried.max() < -2 * self.rounding)
            if not (rises or falls):
                continue
            steps = _steps(box.coefficients, i)
            if not (steps.min() > 2 * self.rounding if rises else steps.max() < -2 * self.rounding):
                continue
            if not _at_limit(axis, box, i, upper=rises):
                return None
            kept = np.ascontiguousarray(np.take(box.coefficients, [n - 1 if rises else 0], axis=i))
            return replace(box, coefficients=kept, face=_with(box.face, i, 1 if rises else -1))
        return box

    def _split(self, box: _Box) -> int | None:
        """The axis to be halved; None if none is wide enough."""
        bends = [
            float(np.abs(_steps(_steps(box.coefficients, i), 1)).max()) if n > 1 and box.level[i] < _DEEPEST else -1.0
            for i, n in enumerate(box.coefficients.shape)
        ]
        return int(np.argmax(bends)) if bends and max(bends) >= 0 else None

    def _halves(self, box: _Box, axis: int) -> list[_Box]:
        """Both halves along an axis, the one with the larger bound last."""
        level = box.level[axis]
        if (axis, level) not in self.halvings:
            self.halvings[axis, level] = self.polynomial.axes[axis].halving(level)
        half = self.halvings[axis, level]
        made = [
            replace(
                box,
                coefficients=apply(matrix, box.coefficients, axis),
                level=_with(box.level, axis, level + 1),
                part=_with(box.part, axis, 2 * box.part[axis] + upwards),
            )
            for upwards, matrix in enumerate((half, half[::-1, ::-1]))
        ]
        return sorted(made, key=lambda each: float(each.coefficients.max()))


def _corners(coefficients: Array) -> Array:
    return coefficients[tuple(slice(None, None, max(n - 1, 1)) for n in coefficients.shape)]


def _steps(coefficients: Array, i: int) -> Array:
    """First differences along an axis, shape (before, n - 1, after)."""
    flat = coefficients.reshape(math.prod(coefficients.shape[:i]), coefficients.shape[i], -1)
    return np.asarray(flat[:, 1:] - flat[:, :-1])


def _with(values: tuple[int, ...], i: int, value: int) -> tuple[int, ...]:
    return (*values[:i], value, *values[i + 1 :])


def _at_limit(axis: Axis, box: _Box, i: int, *, upper: bool) -> bool:
    last_piece, last_part = (axis.pieces - 1, 2 ** box.level[i] - 1) if upper else (0, 0)
    return axis.limits and box.piece[i] == last_piece and box.part[i] == last_part


def largest_value(polynomial: TracePolynomial, known: float, slack: float, *, work: int = WORK) -> Bound:
    """A proven upper bound.

    Args:
        known: the largest value that was found by other means. slack: by how much more the bound may be; what is to be
            proven is that no value exceeds ``known + slack``.
        work: coefficients to look at before the rest is left open.
    """
    changes = [[axis.change(k) for k in range(axis.pieces)] for axis in polynomial.axes]
    search = _Search(polynomial, changes, slack, polynomial.rounding(_DEEPEST), known + slack, known + slack)
    tops = list(_tops(changes, polynomial.values, ()))
    # the hardest pieces come last: what others leave of their quota is theirs
    tried = sorted((top, piece) for piece, top in tops if top + search.rounding > search.threshold)
    search.boxes = len(tops) - len(tried)
    left: dict[tuple[int, ...], tuple[float, float]] = {}
    for _ in range(_ROUNDS):
        for i, (_, piece) in enumerate(tried):
            left[piece] = search.look(_piece(search, piece), (work - search.work) // (len(tried) - i))
        tried = [(top, piece) for top, piece in tried if left[piece][1] > 0]
    return Bound(
        upper=max([search.threshold, *(upper for upper, _ in left.values())]),
        value=search.value,
        pose=search.pose,
        open_share=sum(share for _, share in left.values()) / len(tops),
        boxes=search.boxes,
        rounding=search.rounding,
    )


def _piece(search: _Search, which: tuple[int, ...]) -> _Box:
    values, none = search.polynomial.values, (0,) * len(which)
    for i, k in enumerate(which):
        values = apply(search.changes[i][k], values, i)
    return _Box(values, which, none, none, none)


def _tops(changes: list[list[Array]], values: Array, which: tuple[int, ...]) -> Iterator[tuple[tuple[int, ...], float]]:
    """Every combination of the joints' pieces, and its largest coefficient."""
    if len(which) == len(changes):
        yield which, float(values.max())
        return
    for k, change in enumerate(changes[len(which)]):
        yield from _tops(changes, apply(change, values, len(which)), (*which, k))
