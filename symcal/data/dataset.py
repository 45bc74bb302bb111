"""Measurements as frozen arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Dataset:
    """N measured poses of one robot.

    kind: of instrument, by its name. q: joint readings, shape (N, dof), rad and mm.
    z: what the instrument gave, shape (N, nz); NaN where a point was not seen.
    sigma: standard deviation of every residual component, shape (N, m), mm, rad and px; NaN where the file gives none.
    covariance: of the residual components of every pose, shape (N, m, m), where they are correlated: it then stands for
        the noise instead of ``sigma``. Directions without variance are exact by construction and say nothing.
    labels: the pose's name in its source. split: `train`, `test` or `unused` per pose.
    """

    kind: str
    q: Array
    z: Array
    labels: tuple[str, ...]
    split: tuple[str, ...]
    point_names: tuple[str, ...] = ()
    sigma: Array | None = None
    provenance: str = ""
    notes: tuple[str, ...] = field(default=())
    covariance: Array | None = None

    def __len__(self) -> int:
        return len(self.q)

    def take(self, index: NDArray[np.intp] | Sequence[int] | NDArray[np.bool_]) -> Dataset:
        """The poses of an index or mask, in its order."""
        index = np.flatnonzero(index) if np.asarray(index).dtype == bool else np.asarray(index, dtype=np.intp)
        return replace(
            self,
            q=self.q[index],
            z=self.z[index],
            labels=tuple(self.labels[i] for i in index),
            split=tuple(self.split[i] for i in index),
            sigma=None if self.sigma is None else self.sigma[index],
            covariance=None if self.covariance is None else self.covariance[index],
        )

    def part(self, split: str) -> Dataset:
        """The poses of one split."""
        return self.take(np.array([s == split for s in self.split], dtype=bool))


def with_random_test(data: Dataset, fraction: float, rng: np.random.Generator) -> Dataset:
    """The data with a random share of the poses, but at least one, held out as `test`; at least one stays to train."""
    used = np.flatnonzero([s != "unused" for s in data.split])
    count = max(1, min(round(fraction * len(used)), len(used) - 1))
    split = np.array(data.split, dtype=object)
    split[used] = "train"
    split[rng.permutation(used)[:count]] = "test"
    return replace(data, split=tuple(split))
