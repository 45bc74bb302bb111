"""Truth + plan + noise -> Dataset, with the same expression that identifies."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from symcal.camera.camera import in_image
from symcal.data.dataset import Dataset, Readings
from symcal.errors import RefusedError
from symcal.instruments.noise import Noise
from symcal.model.assembled import margins_kernel, readings_kernel
from symcal.model.contact import constraints, projected, touched
from symcal.model.measurement import Part
from symcal.model.model import Model

Array = NDArray[np.float64]


def simulate(
    model: Model,
    truth: Mapping[str, float],
    q: Array,
    noise: Noise,
    rng: np.random.Generator,
    split: str = "train",
    conditions: Mapping[str, Array] | None = None,
) -> Dataset:
    """What the instrument would give for a robot with known errors.

    Args:
        truth: errors by parameter name, mm and rad. q: joint readings, shape (N, dof); a constraint is touched by the
            postures that nominally lie on it, see `symcal.model.contact`. conditions: by name, shape (N,), of joint
            terms that depend on them (`Dataset.conditions`); those of contacts are nominal.
    Returns:
        measurements with noise, and the readings at which the true robot touches; NaN for a feature that the instrument
        cannot read there, such as a point out of the camera's image, and for a target of which too little is seen.
    Raises:
        RefusedError: a true robot that cannot touch there.

    Example:
        >>> import numpy as np
        >>> import symcal as sc
        >>> robot = sc.load_robot("configs/robots/handling_robot.yaml")
        >>> task, rng = sc.Task.of("position"), np.random.default_rng(1)
        >>> q = rng.uniform(robot.lower, robot.upper, (40, robot.dof))
        >>> data = sc.simulate(sc.build_model(robot, task), {"theta_4": 0.002}, q, sc.Noise(position=0.02), rng)
        >>> data.z.shape
        (40, 3)
    """
    x = model.parameters.vector(truth)
    touching = touched(model.measurement, model.setup, q)
    q = _touching(model, x, q, touching, noise, rng)
    contacts = {part.observation.name: touching[:, i] for i, part in enumerate(constraints(model.measurement))}
    (h,) = readings_kernel(model.measurement, len(q))(q, x, model.setup.under(conditions or {}))
    z = np.empty_like(h)
    for part in model.measurement.parts:
        o = part.observation
        if part.contact is not None:
            z[:, part.readings] = np.where(contacts[o.name], 0.0, np.nan)[:, None]
            continue
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
        conditions=conditions or {},
    )


def _touching(
    model: Model, x: Array, q: Array, touching: NDArray[np.bool_], noise: Noise, rng: np.random.Generator
) -> Array:
    """The postures at which the true robot touches: the ball is not quite at its place, and the joints give way."""
    q = q.copy()
    for i, part in enumerate(constraints(model.measurement)):
        own, o = np.flatnonzero(touching[:, i]), part.observation
        if not len(own):
            continue
        (quantity,) = o.instrument.quantities
        shift = noise.of(o.of, [quantity.noise], rng)[quantity.noise]((len(own), quantity.size))
        beyond = np.full(model.robot.dof, np.inf)
        q[own], met = projected(model, part, q[own], x, -beyond, beyond, shift)
        if not met.all():
            message = f"{(~met).sum()} of {len(own)} postures are where the true robot cannot touch '{o.name}'"
            raise RefusedError(f"{message}: smaller errors, or a place further from the end of its reach, would do")
    return q


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
        conditions={
            name: np.concatenate([first.conditions[name], second.conditions[name]]) for name in first.conditions
        },
    )
