"""Truth + plan + noise -> Dataset, with the same expression that identifies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from symcal.dataset import Dataset
from symcal.kernels import batch_function
from symcal.model import Model

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Noise:
    """Independent noise per axis: standard deviation (normal) or half width (uniform); mm and rad.

    The noise of a pose's orientation is a rotation vector applied on the right (in the frame that is measured).
    """

    distribution: Literal["normal", "uniform"] = "normal"
    position: float = 0.0
    orientation: float = 0.0

    def draw(self, size: float, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
        if self.distribution == "uniform":
            return np.asarray(rng.uniform(-size, size, shape))
        return np.asarray(size * rng.normal(size=shape))

    def sigma(self, size: float) -> float:
        """Standard deviation per axis of noise of this size."""
        return size / np.sqrt(3) if self.distribution == "uniform" else size


def simulate(
    model: Model, truth: Mapping[str, float], q: Array, noise: Noise, rng: np.random.Generator, split: str = "train"
) -> Dataset:
    """What the instrument would give for a robot with known errors.

    Args:
        truth: errors by parameter name, mm and rad. q: joint readings, shape (N, dof).
    """
    x = model.parameters.vector(truth)
    (z,) = batch_function(model.measurement.predict, evaluations=len(q))(q, x, model.setup.vector)
    if model.task.kind == "position":
        z = z + noise.draw(noise.position, z.shape, rng)
    else:
        position = z[:, :3] + noise.draw(noise.position, (len(z), 3), rng)
        turn = Rotation.from_rotvec(noise.draw(noise.orientation, (len(z), 3), rng))
        z = np.hstack([position, (Rotation.from_quat(z[:, 3:]) * turn).as_quat(canonical=True)])
    return Dataset(
        kind=model.task.kind,
        q=q,
        z=z,
        labels=tuple(str(i) for i in range(len(q))),
        split=(split,) * len(q),
        point_names=model.measurement.point_names,
        provenance="simulated",
    )


def concatenate(first: Dataset, second: Dataset) -> Dataset:
    """Two simulated sets of one model as one; poses are numbered through."""
    return Dataset(
        kind=first.kind,
        q=np.vstack([first.q, second.q]),
        z=np.vstack([first.z, second.z]),
        labels=tuple(str(i) for i in range(len(first) + len(second))),
        split=first.split + second.split,
        point_names=first.point_names,
        provenance=first.provenance,
    )
