"""Truth + plan + noise -> Dataset, with the same expression that identifies."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import in_image
from symcal.data.dataset import Dataset, Readings
from symcal.instruments.noise import Noise
from symcal.model.assembled import margins_kernel, readings_kernel
from symcal.model.measurement import Part
from symcal.model.model import Model

Array = NDArray[np.float64]


def simulate(
    model: Model, truth: Mapping[str, float], q: Array, noise: Noise, rng: np.random.Generator, split: str = "train"
) -> Dataset:
    """What the instrument would give for a robot with known errors.

    Args:
        truth: errors by parameter name, mm and rad. q: joint readings, shape (N, dof).
    Returns:
        measurements with noise; NaN for a feature that the instrument cannot read there, such as a point out of the
        camera's image, and for a target of which too little is seen.
    """
    x = model.parameters.vector(truth)
    (h,) = readings_kernel(model.measurement, len(q))(q, x, model.setup.vector)
    z = np.empty_like(h)
    for part in model.measurement.parts:
        o = part.observation
        exact = h[:, part.readings].reshape(len(q), -1, len(o.instrument.columns))
        drawn = noise.of(o.of, [quantity.noise for quantity in o.instrument.quantities], rng)
        read = o.instrument.retract(exact, drawn)
        z[:, part.readings] = np.where(_can_be_read(model, part, x, q, read)[:, :, None], read, np.nan).reshape(
            len(q), -1
        )
    return Dataset(
        of=tuple(Readings(o.instrument, o.name, o.features) for o in model.task.observations),
        q=q,
        z=z,
        labels=tuple(str(i) for i in range(len(q))),
        split=(split,) * len(q),
        provenance="simulated",
    )


def _can_be_read(model: Model, part: Part, x: Array, q: Array, read: Array) -> NDArray[np.bool_]:
    """Which features are within the instrument's limits, shape (N, k); of image points also where noise takes them."""
    margins = margins_kernel(part, len(q))
    if margins is None:
        return np.ones(read.shape[:2], dtype=np.bool_)
    seen = (margins(q, x, model.setup.vector) > 0).all(axis=2)
    camera, target = part.observation.instrument.camera, part.observation.target
    if camera is not None:
        seen &= in_image(camera, read)
        seen &= (seen.sum(axis=1) >= target.needed)[:, None]
    return np.asarray(seen)


def concatenate(first: Dataset, second: Dataset) -> Dataset:
    """Two simulated sets of one model as one; poses are numbered through."""
    return Dataset(
        of=first.of,
        q=np.vstack([first.q, second.q]),
        z=np.vstack([first.z, second.z]),
        labels=tuple(str(i) for i in range(len(first) + len(second))),
        split=first.split + second.split,
        provenance=first.provenance,
    )
