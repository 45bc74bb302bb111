"""What is touched: where it stands in world, and the marks by which figures tell one thing from another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symcal.kernels import batch_function
from symcal.model.contact import constraints
from symcal.model.measurement import Measurement, Part, Setup
from symcal.plots.style import BLUE, GREEN, INK, ORANGE, PURPLE, VERMILION

Array = NDArray[np.float64]

MARKS = ((BLUE, "o"), (VERMILION, "s"), (GREEN, "^"), (ORANGE, "D"), (INK, "v"), (PURPLE, "P"))
"""Colour and marker of one thing after the other."""

_TOGETHER = 0.1  # of the scene's size: things nearer than this share a label


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """A place that is touched: part, what touches it; frame, where it stands in world, shape (4, 4), mm."""

    part: Part
    frame: Array

    @property
    def name(self) -> str:
        return self.part.observation.name

    @property
    def place(self) -> Array:
        """Its origin, shape (3,), mm."""
        return np.asarray(self.frame[:3, 3])

    @property
    def flat(self) -> bool:
        """Whether one number says how far a point is from it: a plane."""
        return self.part.size == self.part.features

    def touched_by(self, q: Array, x: Array, setup: Setup) -> Array:
        """Where postures (N, dof) touch it in world, shape (N, 3), mm."""
        if self.part.observation.at.moves or not self.flat:
            return np.tile(self.place, (len(q), 1))
        assert self.part.contact is not None
        point = batch_function(self.part.contact, evaluations=0)(q, x, setup.vector)[2].reshape(len(q), -1, 3)[:, 0]
        return np.asarray(point @ self.frame[:3, :3].T + self.place)


def things(measurement: Measurement, setup: Setup) -> tuple[Thing, ...]:
    """Everything that is touched and does not move itself, in the order of the measurement.

    Args:
        setup: increments of places carried out, see `symcal.model.model.Model.moved`.
    """
    found = []
    for part in constraints(measurement):
        o = part.observation
        end, name = (o.target.at, o.target.name) if o.at.moves else (o.at, o.place)
        if end.moves:
            continue
        frame = (setup.base if end.on == "base" else np.eye(4)) @ setup.places.get(name, np.eye(4))
        if o.at.moves and o.features:
            frame = frame.copy()
            point = setup.points[measurement.points_called.index(o.target.qualified(o.features[0]))]
            frame[:3, 3] += frame[:3, :3] @ point
        found.append(Thing(part, frame))
    return tuple(found)


def labels(names: Sequence[str], points: Array, size: float) -> list[tuple[Array, str]]:
    """Names at points, shape (k, 3), those of points that lie together in one: where, and the words."""
    left, found = list(range(len(points))), []
    while left:
        near = [i for i in left if np.linalg.norm(points[i] - points[left[0]]) < _TOGETHER * size]
        found.append((points[near].mean(axis=0), ", ".join(names[i] for i in near)))
        left = [i for i in left if i not in near]
    return found


def patch(frame: Array, points: Array, margin: float) -> Array:
    """Corners of the piece of a plane (z of ``frame`` its normal) around points in it, shape (4, 3), mm."""
    local = (points - frame[:3, 3]) @ frame[:3, :2]
    low, high = local.min(axis=0) - margin, local.max(axis=0) + margin
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    return np.asarray(corners @ frame[:3, :2].T + frame[:3, 3])


def sign(i: int, *, hollow: bool = False) -> dict[str, Any]:
    """Keyword arguments for markers of the i-th thing, without a line."""
    color, marker = MARKS[i % len(MARKS)]
    return {"linestyle": "none", "marker": marker, "color": color, "markerfacecolor": "white" if hollow else color}
