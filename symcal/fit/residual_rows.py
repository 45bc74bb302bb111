"""A dataset's residuals as a function of the parameters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symcal.data.dataset import Dataset
from symcal.model.assembled import RowKernel, rows_kernel
from symcal.model.measurement import Measurement, Setup
from symcal.model.staged_kernel import StagedKernel, Twists

Array = NDArray[np.float64]

FEW_POSES, FEW_COMPONENTS = 1024, 12_288
"""Of more poses and components of residuals than these, the Jacobian is never held whole: see `Rows.pieces`."""
_AT_ONCE = 3072  # components of a piece: with its slopes it stays in the cache of a processor
_FEWEST = 64  # poses of a piece
_NO_VARIANCE = 1e-13
"""Variances below this share of a pose's largest are rounding of none at all."""


@dataclass(frozen=True, slots=True)
class Linear:
    """The rows of a dataset linearised at some x; made by `Rows.at`.

    r: shape (N, m), zero where nothing was measured. slopes: by observation its columns in r, its poses, and J there,
    (N_k, m_k, n), written out or in two factors.
    """

    r: Array
    slopes: tuple[tuple[slice, NDArray[np.intp], Array | Twists], ...]

    def moved(self, step: Array) -> Array:
        """r + J step: the residuals to first order after a change of all parameters, shape (N, m).

        Args:
            step: of every pose, shape (N, n).
        """
        out = self.r.copy()
        for columns, poses, slopes in self.slopes:
            jacobian = slopes.jacobian if isinstance(slopes, Twists) else slopes
            moved = (jacobian @ step[poses][:, :, None])[:, :, 0]
            out[np.ix_(poses, np.arange(self.r.shape[1])[columns])] += moved
        return out

    def weighted(self, spread: Array, index: NDArray[np.intp], scales: Array) -> Array:
        """Whitened [J S, r] by some parameters, shape (k, n' + 1).

        A row for each component of finite spread; fewer, with the same triangle, where points come in one piece
        (`Twists.compressed`).

        Args:
            spread: standard deviation of every component, shape (N, m); infinite where it does not count.
            scales: S, shape (n',).
        """
        found = []
        for columns, poses, slopes in self.slopes:
            whole = len(poses) == len(self.r)
            own = spread[:, columns] if whole else spread[poses, columns]
            if isinstance(slopes, Twists):
                rows = slopes.compressed(own, index)
                rows[:, :-1] *= scales
            else:
                rows = _picked(self.r[:, columns] if whole else self.r[poses, columns], slopes, own, index, scales)
            found.append(rows)
        return found[0] if len(found) == 1 else np.vstack(found)


def _picked(r: Array, jacobian: Array, spread: Array, index: NDArray[np.intp], scales: Array) -> Array:
    keep = np.flatnonzero(np.isfinite(spread).ravel())
    inverse = 1 / spread.ravel()[keep]
    out = np.empty((len(keep), len(index) + 1))
    flat = jacobian.reshape(r.size, -1)
    np.multiply(flat[:, index] if len(keep) == r.size else flat[np.ix_(keep, index)], scales, out=out[:, :-1])
    out[:, -1] = r.ravel()[keep]
    out *= inverse[:, None]
    return out


@dataclass(frozen=True, slots=True)
class Rows:
    """Residuals of a dataset: x -> r (N, m) and J (N, m, n); components that were not measured are zero.

    kernels: of every observation. poses: which poses it has read, shape (N_k,) each.
    mixing: whitening matrix of every pose, shape (N, m, m), applied to both; None where components stay as they are.
    unplaced: parameters that nothing here tells; what is known of their things does not count.
    """

    measurement: Measurement
    data: Dataset
    setup: Setup
    kernels: tuple[RowKernel, ...]
    poses: tuple[NDArray[np.intp], ...]
    z: Array
    seen: NDArray[np.bool_]
    mixing: Array | None = None
    unplaced: frozenset[str] = frozenset()
    # Made on first use, never changed after.
    _pieces: list[tuple[slice, Rows]] = field(default_factory=list, init=False, compare=False, repr=False)

    def values(self, x: Array) -> tuple[Array, Array]:
        """What is known between things, over its noise: r (k,) and J (k, n)."""
        r, jacobian = [np.zeros(0)], [np.zeros((0, len(self.measurement.parameters)))]
        for observation, own, slopes in self.measurement.known_rows(x, self.setup):
            if self.unplaced.isdisjoint(observation.names):
                r.append(own)
                jacobian.append(slopes)
        return np.concatenate(r), np.vstack(jacobian)

    def __call__(self, x: Array) -> tuple[Array, Array]:
        r, jacobian = self._evaluated(x)
        if self.mixing is not None:
            r, jacobian = np.einsum("nij,nj->ni", self.mixing, r), self.mixing @ jacobian
        if self.seen.all():
            return r, jacobian
        return np.where(self.seen, r, 0.0), np.where(self.seen[:, :, None], jacobian, 0.0)

    def at(self, x: Array) -> Linear:
        """The rows linearised at x."""
        if self.mixing is not None or not any(isinstance(kernel, StagedKernel) for kernel in self.kernels):
            r, jacobian = self(x)
            return Linear(r, ((slice(0, r.shape[1]), np.arange(len(r)), jacobian),))
        r = np.zeros((len(self.data), self.measurement.rows))
        slopes: list[tuple[slice, NDArray[np.intp], Array | Twists]] = []
        for part, kernel, poses in zip(self.measurement.parts, self.kernels, self.poses, strict=True):
            if not poses.size:
                continue
            q, z, seen = self.data.q[poses], self.z[poses, part.readings], self.seen[poses, part.components]
            setup = self._setup(poses)
            if isinstance(kernel, StagedKernel):
                points = np.asarray(seen.reshape(len(poses), part.features, -1).any(axis=2))
                twists = kernel.twists(q, x, setup, z, points)
                r[poses, part.components] = np.where(seen, twists.r, 0.0)
                slopes.append((part.components, poses, twists))
            else:
                own, jacobian = kernel(q, x, setup, z)
                r[poses, part.components] = np.where(seen, own, 0.0)
                slopes.append((part.components, poses, jacobian))
        return Linear(r, tuple(slopes))

    def residual(self, x: Array) -> Array:
        """The residuals alone, shape (N, m)."""
        if not self.many:
            return self.at(x).r
        out = np.empty(self.seen.shape)
        for own, rows in self.pieces():
            out[own] = rows.at(x).r
        return out

    @property
    def many(self) -> bool:
        """Whether there are so many that their Jacobian is never held whole."""
        return len(self.seen) > FEW_POSES and self.seen.size > FEW_COMPONENTS

    def pieces(self) -> Sequence[tuple[slice, Rows]]:
        """Which poses, and their rows: a piece at a time where there are `many`, else all at once.

        Borders are by the numbers of poses and components alone, so that results repeat.
        """
        if not self.many:
            return ((slice(0, len(self.seen)), self),) if len(self.seen) else ()
        if not self._pieces:
            count, step = len(self.seen), max(_AT_ONCE // self.seen.shape[1], _FEWEST)
            borders = [slice(first, min(first + step, count)) for first in range(0, count, step)]
            self._pieces.extend((own, self.take(own)) for own in borders)
        return self._pieces

    def take(self, poses: slice | NDArray[np.intp]) -> Rows:
        """The rows of some poses, in their order; of consecutive ones their data are nameless."""
        return replace(
            self,
            data=self.data.between(poses) if isinstance(poses, slice) else self.data.take(poses),
            poses=tuple(_among(own, poses, len(self.seen)) for own in self.poses),
            z=self.z[poses],
            seen=self.seen[poses],
            mixing=None if self.mixing is None else self.mixing[poses],
        )

    def _evaluated(self, x: Array) -> tuple[Array, Array]:
        if len(self.kernels) == 1:
            r, jacobian = self.kernels[0](self.data.q, x, self._setup(), self.z)
            return r, jacobian
        r = np.zeros((len(self.data), self.measurement.rows))
        jacobian = np.zeros((*r.shape, len(self.measurement.parameters)))
        for poses, columns, own, slopes in self.read(x):
            r[poses, columns], jacobian[poses, columns] = own, slopes
        return r, jacobian

    def read(self, x: Array) -> Iterator[tuple[NDArray[np.intp], slice, Array, Array]]:
        """By observation that has read anything its poses, its columns, and r and J there, as they come: of components
        that were not measured too, and in no axes but its own."""
        for part, kernel, poses in zip(self.measurement.parts, self.kernels, self.poses, strict=True):
            if poses.size:
                r, jacobian = kernel(self.data.q[poses], x, self._setup(poses), self.z[poses, part.readings])
                yield poses, part.components, r, jacobian

    def _setup(self, poses: NDArray[np.intp] | None = None) -> Array:
        """The setup's numbers under the conditions of the poses, see `Setup.under`."""
        given = self.data.conditions
        return self.setup.under(given if poses is None else {name: values[poses] for name, values in given.items()})

    def decorrelated(self) -> Rows:
        """The rows in the principal axes of the data's covariance, of unit variance; as they are without one.

        With C = U diag(c) U^T the rows are diag(c)^-1/2 U^T r; those without variance are left out as not measured.
        """
        if self.data.covariance is None:
            return self
        variance, axes = np.linalg.eigh(self.data.covariance)
        kept = variance > _NO_VARIANCE * variance[:, -1:]
        scale = np.where(kept, 1 / np.sqrt(np.where(kept, variance, 1.0)), 0.0)
        return replace(self, mixing=scale[:, :, None] * axes.swapaxes(1, 2), seen=kept)


def _among(read: NDArray[np.intp], poses: slice | NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """Which of some poses are among those that were read, in ascending order."""
    if isinstance(poses, slice):
        first, last = np.searchsorted(read, (poses.start, poses.stop))
        return np.asarray(read[first:last] - poses.start)
    return np.flatnonzero(np.bincount(read, minlength=count)[poses])


def rows_of(
    measurement: Measurement,
    data: Dataset,
    setup: Setup,
    kernels: tuple[RowKernel, ...] | None = None,
    unplaced: Iterable[str] = (),
) -> Rows:
    """The residual rows of a dataset under a setup; kernels made before may be used again."""
    kernels = kernels or tuple(rows_kernel(part) for part in measurement.parts)
    by_part = [part.seen(data.z) for part in measurement.parts]
    poses = tuple(np.flatnonzero(seen.any(axis=1)) for seen in by_part)
    z, seen = np.nan_to_num(data.z), np.hstack(by_part)
    return Rows(measurement, data, setup, kernels, poses, z, seen, unplaced=frozenset(unplaced))
