"""Truth + plan + noise -> Dataset, with the same expression that identifies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import Camera, in_image
from symcal.data.dataset import Dataset
from symcal.instruments.protocol import Draw
from symcal.kernels import batch_function
from symcal.model.model import Model

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Noise:
    """Independent noise per axis: standard deviation (normal) or half width (uniform); mm, rad and px.

    The noise of a pose's orientation is a rotation vector applied on the right (in the frame that is measured).
    """

    distribution: Literal["normal", "uniform"] = "normal"
    position: float = 0.0
    orientation: float = 0.0
    image: float = 0.0

    def draw(self, size: float, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
        if self.distribution == "uniform":
            return np.asarray(rng.uniform(-size, size, shape))
        return np.asarray(size * rng.normal(size=shape))

    def by_name(self, rng: np.random.Generator) -> dict[str, Draw]:
        """What draws the noise of each quantity, by the name of its sigma."""
        sizes = {"position": self.position, "orientation": self.orientation, "image": self.image}
        return {name: partial(self._drawn, size, rng) for name, size in sizes.items()}

    def _drawn(self, size: float, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        return self.draw(size, shape, rng)

    def sigma(self, size: float) -> float:
        """Standard deviation per axis of noise of this size."""
        return size / np.sqrt(3) if self.distribution == "uniform" else size


def simulate(
    model: Model, truth: Mapping[str, float], q: Array, noise: Noise, rng: np.random.Generator, split: str = "train"
) -> Dataset:
    """What the instrument would give for a robot with known errors.

    Args:
        truth: errors by parameter name, mm and rad. q: joint readings, shape (N, dof).
    Returns:
        measurements with noise; NaN for a target point that is out of the camera's image.
    """
    x = model.parameters.vector(truth)
    (z,) = batch_function(model.measurement.predict, evaluations=len(q))(q, x, model.setup.vector)
    kind = model.measurement.kind
    readings = z.reshape(len(q), -1, len(kind.columns))
    z = kind.retract(readings, noise.by_name(rng)).reshape(z.shape)
    if model.task.scene is not None:
        z = np.where(_in_view(model, model.task.scene.camera, x, q, z), z, np.nan)
    return Dataset(
        kind=model.task.kind,
        q=q,
        z=z,
        labels=tuple(str(i) for i in range(len(q))),
        split=(split,) * len(q),
        point_names=model.measurement.point_names,
        provenance="simulated",
    )


def _in_view(model: Model, camera: Camera, x: Array, q: Array, z: Array) -> NDArray[np.bool_]:
    """Which image coordinates, shape (N, 2 k), belong to points in front of the camera and inside the image."""
    world, _ = model.points(q, x, model.setup.vector)
    frame = model.setup.moved(model.parameters.mapping(x), model.measurement.point_names).camera
    assert frame is not None
    depth = (world.reshape(len(q), -1, 3) - frame[:3, 3]) @ frame[:3, 2]
    seen = in_image(camera, z.reshape(len(q), -1, 2)) & (depth > 0)
    return np.repeat(seen, 2, axis=1)


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
