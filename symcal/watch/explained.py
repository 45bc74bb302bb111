"""One explanation of a check's readings, that nothing changed or one thing did, and what others would add to it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.fit.options import Options
from symcal.model.task import Task
from symcal.parameters import frame_names
from symcal.placing.placement import place
from symcal.spatial import inverse, matrix_vectors
from symcal.watch.directed import Law, Tested, White, added, in_direction, left_over, whitening
from symcal.watch.reference import BASE, Hypothesis, Linear, Reference, carried_out, linear_at

Array = NDArray[np.float64]

_STEPS = 30
_STILL = 1e-7  # of a plausible size: a step that ends the fit
_BEYOND = 1e6  # mm or rad: it runs away


@dataclass(frozen=True, slots=True, eq=False)
class Explained:
    """Readings with one thing changed, or nothing; made by `explain`.

    linear: about the fit. white: whitened there. given: orthonormal basis of what was fitted, shape (k, g).
    y: values of all that may change, shape (c,); covariance: of those of the hypothesis, shape (d, d). ended: the fit
    came to an end.
    """

    linear: Linear
    white: White
    given: Array
    y: Array
    covariance: Array
    ended: bool

    def columns(self, index: NDArray[np.intp]) -> Array:
        """D* of some parameters, shape (k, d)."""
        return self.white.mixing @ self.linear.slopes[:, index]

    def adds(self, index: NDArray[np.intp], law: Law) -> Tested:
        """What a change of some parameters explains beyond this."""
        return in_direction(self.white.r, added(self.given, self.columns(index)), law)

    def pose(self, number: int, law: Law) -> Tested:
        """What a shift of all readings of a pose explains beyond this."""
        own = self.white.mixing[:, self.white.pose == number]
        return in_direction(self.white.r, added(self.given, own), law)

    def rest(self, law: Law) -> Tested:
        """The sum of squares of what this leaves."""
        return left_over(self.white.r, self.given, law)


def explain(reference: Reference, data: Dataset, changed: Hypothesis | None, base: Array | None) -> Explained:
    """The readings with one thing changed by what fits best, or with nothing changed.

    Args:
        base: where it roughly is if the instrument was set up anew (`placed_base`), shape (4, 4): it is then found from
            these readings in any case.
    """
    found = _fitted(reference, data, changed, base, moved=base is not None)
    of_base = base is None and changed is not None and changed.name == BASE
    if of_base and not found.ended:  # it is far from where it was
        assert changed is not None
        there = placed_base(reference, data)
        found = _fitted(reference, data, changed, there, moved=False)
        y, index = found.y.copy(), reference.index(changed)
        y[index] = _motion(reference.robot.base, carried_out(there, y[index]))
        return replace(found, y=y)
    return found


def _fitted(
    reference: Reference,
    data: Dataset,
    changed: Hypothesis | None,
    base: Array | None,
    *,
    moved: bool,
) -> Explained:
    """By Gauss-Newton."""
    ground = reference.named(BASE) if moved else None
    own = np.zeros(0, dtype=np.intp) if changed is None else reference.index(changed)
    index = own if ground is None else np.concatenate([reference.index(ground), own])
    scales = np.array([*(() if ground is None else ground.scales), *(() if changed is None else changed.scales)])
    y, ended = np.zeros(len(reference.changed.parameters)), False
    for _ in range(_STEPS):
        linear = linear_at(reference, data, y, base)
        mixing = whitening(linear.reference, reference.root, linear.spread)
        r, columns = mixing @ linear.r, mixing @ linear.slopes[:, index] * scales
        move = np.linalg.lstsq(columns, -r, rcond=1e-9)[0]
        ended = bool(np.all(np.abs(move) < _STILL))
        if ended or not np.isfinite(move).all() or np.any(np.abs(y[index] + move * scales) > _BEYOND):
            break
        y[index] += move * scales
    given = added(np.zeros((len(r), 0)), columns)
    inverse = np.linalg.pinv(columns.T @ columns, rcond=1e-12, hermitian=True) * np.outer(scales, scales)
    part = slice(len(index) - len(own), None)
    return Explained(linear, White(r, mixing, linear.pose), given, y, inverse[part, part], ended)


def placed_base(reference: Reference, data: Dataset) -> Array:
    """Where the base stands by these readings, the calibrated robot and what it carries as they were."""
    model = reference.changed
    carried = [name for name in model.placement if name not in frame_names(BASE)]
    held: Task = replace(model.task, fix=tuple(carried))
    return place(replace(model, task=held), data, Options()).base


def _motion(frame: Array, now: Array) -> Array:
    """The increments x to rz that take a frame to where it is now, shape (6,)."""
    step = inverse(frame) @ now
    return np.array([*step[:3, 3], *matrix_vectors(step[:3, :3])])


def outlying(explanations: Iterable[Explained], poses: int, law: Law) -> tuple[int, float]:
    """The pose that stands out most whichever of these explanations is true, and the probability of that by chance."""
    p = np.max([[each.pose(k, law).p for k in range(poses)] for each in explanations], axis=0)
    worst = int(np.argmin(p))
    return worst, float(min(p[worst] * poses, 1.0))
