"""Both stages of a rigid target evaluated: poses one by one, then every point of every pose in one batch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.kernels import BatchFunction, batch_function
from symcal.model.stages import Stages

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
_AT_ONCE = 6000  # points: as many stay in the cache of a processor
Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Pose and point of everything that was seen."""


@dataclass(frozen=True, slots=True)
class Twists:
    """Residuals of N poses and what they change with, in two factors: J = by_twist S, and by_own at ``columns``.

    r: shape (N, m). by_twist: (N, m, 6). by_own: (N, m, k). screws: S, (N, 6, n).
    """

    r: Array
    by_twist: Array
    by_own: Array
    screws: Array
    columns: NDArray[np.intp]

    @property
    def jacobian(self) -> Array:
        """J by all parameters, shape (N, m, n)."""
        out = np.asarray(self.by_twist @ self.screws)
        out[:, :, self.columns] += self.by_own
        return out

    def compressed(self, spread: Array, index: NDArray[np.intp]) -> Array:
        """See `packed`: the rows of all poses one after the other, shape (N h, n' + 1)."""
        return self.packed(spread, index).reshape(-1, len(index) + 1)

    def packed(self, spread: Array, index: NDArray[np.intp]) -> Array:
        """Whitened [J, r] of some parameters with the same triangle: at most 6 + k + 1 rows for each pose.

        With the rows of a pose divided by their spread, [J_twist J_own r] = Q R, the rows are R with its first six
        columns multiplied by the screws.

        Args:
            spread: standard deviation of every component, shape (N, m), infinite where it does not count.
            index: the n' parameters.
        Returns:
            shape (N, h, n' + 1).
        """
        places = {int(column): i for i, column in enumerate(index)}
        weight = (np.isfinite(spread) / np.where(np.isfinite(spread), spread, 1.0))[:, :, None]
        stacked = np.empty((*self.r.shape, 7 + len(self.columns)))
        np.multiply(self.by_twist, weight, out=stacked[:, :, :6])
        np.multiply(self.by_own, weight, out=stacked[:, :, 6:-1])
        np.multiply(self.r[:, :, None], weight, out=stacked[:, :, -1:])
        triangle: Array = np.asarray(np.linalg.qr(stacked, mode="r"))
        triangle *= np.where(np.einsum("nii->ni", triangle[:, :, : triangle.shape[1]]) < 0, -1.0, 1.0)[:, :, None]
        out = np.empty((*triangle.shape[:2], len(index) + 1))
        np.matmul(triangle[:, :, :6], np.ascontiguousarray(self.screws[:, :, index]), out=out[:, :, :-1])
        out[:, :, -1] = triangle[:, :, -1]
        for i, column in enumerate(self.columns.tolist()):
            if column in places:
                out[:, :, places[column]] += triangle[:, :, 6 + i]
        return out


@dataclass(frozen=True, slots=True)
class StagedKernel:
    """An observation of many known points, for N poses in one call; made by `staged_kernel`.

    Calls take what those of a `BatchFunction` of the whole expression would, and give the same: (q, x, setup, z) -> r
    and J. Readings and residuals of a pose hold one point after the other.
    """

    pose: BatchFunction
    residual: BatchFunction
    planned: BatchFunction
    reading: BatchFunction
    margin: BatchFunction
    miss: BatchFunction
    columns: NDArray[np.intp]
    points: Array

    @property
    def chunk(self) -> int:
        """Poses that are best evaluated at once, where there are very many."""
        return max(_AT_ONCE // len(self.points), 1)

    def __call__(self, q: Array, x: Array, setup: Array, z: Array) -> tuple[Array, Array]:
        found = self.twists(q, x, setup, z)
        return found.r, found.jacobian

    def twists(self, q: Array, x: Array, setup: Array, z: Array, seen: Mask | None = None) -> Twists:
        """Residuals and their slopes in two factors.

        Args:
            z: shape (N, K columns). seen: which points were, shape (N, K); the rows of others are zero. All when None.
        """
        place, _, own, screws = self._posed(q, x, setup)
        at = self._pairs(len(q), seen)
        r, by_twist, by_own = self.residual(*self._at(place, at), self._readings(z, at), self._own(own, x, at))
        return self._twists(r, by_twist, by_own, screws, at)

    def slopes(self, q: Array, x: Array, setup: Array, seen: Mask | None = None) -> Twists:
        """The same at a residual of zero: of readings that are yet to be taken."""
        place, _, own, screws = self._posed(q, x, setup)
        at = self._pairs(len(q), seen)
        by_twist, by_own = self.planned(*self._at(place, at), self._own(own, x, at))
        return self._twists(np.zeros(by_twist.shape[:2]), by_twist, by_own, screws, at)

    def jacobian(self, q: Array, x: Array, setup: Array) -> Array:
        """The same by all parameters, shape (N, m, n)."""
        return self.slopes(q, x, setup).jacobian

    def readings(self, q: Array, x: Array, setup: Array) -> Array:
        """What would be read, shape (N, K columns)."""
        return self._each(self.reading, q, x, setup)

    def margins(self, q: Array, x: Array, setup: Array) -> Array:
        """By how much each point can be read, shape (N, K, limits)."""
        return self._each(self.margin, q, x, setup).reshape(len(q), len(self.points), self.margin.outputs[0].rows)

    def errors(self, q: Array, x: Array, setup: Array, z: Array) -> Array:
        """What is judged of each point, shape (N, K d)."""
        place, turn, own, _ = self._posed(q, x, setup)
        at = self._pairs(len(q), None)
        where, points = self._at(place, at)
        (found,) = self.miss(where, turn[at[0]], points, self._readings(z, at), self._own(own, x, at))
        return np.asarray(found.reshape(len(q), len(self.points) * found.shape[1]))

    def _each(self, function: BatchFunction, q: Array, x: Array, setup: Array) -> Array:
        if len(q) > self.chunk and x.ndim == 1:
            parts = np.array_split(q, -(-len(q) // self.chunk))
            return np.concatenate([self._each(function, part, x, setup) for part in parts])
        place, _, own, _ = self._posed(q, x, setup)
        at = self._pairs(len(q), None)
        (found,) = function(*self._at(place, at), self._own(own, x, at))
        return np.asarray(found.reshape(len(q), len(self.points) * found.shape[1]))

    def _posed(self, q: Array, x: Array, setup: Array) -> tuple[Array, Array, Array, Array]:
        place, turn, own, screws = self.pose(q, x, setup)
        return place, turn, own, screws if screws.ndim == 3 else screws[:, :, None]

    def _twists(self, r: Array, by_twist: Array, by_own: Array, screws: Array, at: Pairs) -> Twists:
        by_own = by_own.reshape(*r.shape, len(self.columns))
        r, by_twist, by_own = (self._spread(each, len(screws), at) for each in (r, by_twist, by_own))
        return Twists(r, by_twist, by_own, screws, self.columns)

    def _pairs(self, count: int, seen: Mask | None) -> Pairs:
        if seen is None:
            seen = np.ones((count, len(self.points)), dtype=np.bool_)
        pose, point = np.nonzero(seen)
        return pose, point

    def _at(self, place: Array, at: Pairs) -> tuple[Array, Array]:
        if len(at[0]) == len(place) * len(self.points):  # everything: the same, faster
            return np.repeat(place, len(self.points), axis=0), np.tile(self.points, (len(place), 1))
        return place[at[0]], self.points[at[1]]

    def _readings(self, z: Array, at: Pairs) -> Array:
        return np.asarray(z.reshape(len(z), len(self.points), z.shape[1] // len(self.points))[at])

    def _own(self, own: Array, x: Array, at: Pairs) -> Array:
        """Numbers of the instrument: the same for all poses, unless the errors differ from pose to pose."""
        return own[0] if x.ndim == 1 and len(own) else own[at[0]]

    def _spread(self, values: Array, count: int, at: Pairs) -> Array:
        """Values of pairs as rows of poses, one point after the other, zero where nothing was seen."""
        if len(values) == count * len(self.points):
            out = values
        else:
            out = np.zeros((count, len(self.points), *values.shape[1:]))
            out[at] = values
        return np.asarray(out.reshape(count, len(self.points) * values.shape[1], *values.shape[2:]))


def staged_kernel(stages: Stages) -> StagedKernel:
    """The functions of both stages made ready; what is called a few times only is not compiled."""
    return StagedKernel(
        pose=batch_function(stages.pose),
        residual=batch_function(stages.residual),
        planned=batch_function(stages.planned),
        reading=batch_function(stages.reading, evaluations=0),
        margin=batch_function(stages.margins),
        miss=batch_function(stages.miss, evaluations=0),
        columns=stages.columns,
        points=stages.points,
    )
