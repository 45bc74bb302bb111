"""What is random in a trial: true errors, poses, noise; in this order, from the trial's own stream alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.simulate import simulate
from symcal.errors import RefusedError
from symcal.trials.description import Cell, Description
from symcal.trials.setting import Setting

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Drawn:
    """The data of R trials of one cell.

    generators: where each stream stands after its noise. truth: errors of the true robot, shape (R, n'), mm and rad.
    q: joint readings, (N, dof) where all trials share the plan, else (R, N, dof). z: (R, N, nz).
    refused: why a trial has no data, by its place; its z is NaN.
    """

    generators: tuple[np.random.Generator, ...]
    truth: Array
    q: Array
    z: Array
    refused: dict[int, str]

    def poses(self, i: int) -> Array:
        return self.q if self.q.ndim == 2 else self.q[i]


def draw(description: Description, setting: Setting, cell: Cell, trials: Sequence[int]) -> Drawn:
    """True errors, poses and noisy readings of some trials of one cell."""
    generators = tuple(description.generator(trial) for trial in trials)
    drawn = np.array([g.standard_normal(len(description.spread)) for g in generators]) if cell.drawn else None
    truth = np.broadcast_to(setting.truth(description, cell, drawn), (len(trials), len(setting.true_model.parameters)))
    refused: dict[int, str] = {}
    if cell.poses_of is None:
        q = np.full((len(trials), cell.poses, len(description.lower)), np.nan)
        for i, generator in enumerate(generators):
            try:
                q[i] = setting.random(generator, cell.poses)
            except RefusedError as error:
                refused[i] = str(error)
    else:
        q = description.plans[cell.poses_of][: cell.poses]
    if setting.written_out:
        return Drawn(generators, truth, q, _readings(setting, cell, generators, truth, q), refused)
    return _simulated(setting, cell, generators, truth, q, refused)


def _readings(setting: Setting, cell: Cell, generators: Sequence[np.random.Generator], truth: Array, q: Array) -> Array:
    """What the instruments give, with noise, shape (R, N, nz); as `symcal.calibration.simulate` draws it."""
    model, count = setting.true_model, len(truth)
    same = q.ndim == 2 and not cell.drawn
    if same:
        exact = setting.readings(q, truth[0], model.setup.vector)[0][None]
    else:
        whole = np.broadcast_to(q, (count, *q.shape[-2:])).reshape(-1, q.shape[-1])
        x = truth[0] if not cell.drawn else np.repeat(truth, q.shape[-2], axis=0)
        exact = setting.readings(np.ascontiguousarray(whole), x, model.setup.vector)[0]
        exact = exact.reshape(count, q.shape[-2], -1)
    z = np.empty((count, *exact.shape[1:]))
    for i, generator in enumerate(generators):
        own = exact[0] if same else exact[i]
        for part in model.measurement.parts:
            o = part.observation
            read = own[:, part.readings].reshape(len(own), -1, len(o.instrument.columns))
            noise = cell.noise.of(o.of, [quantity.noise for quantity in o.instrument.quantities], generator)
            z[i][:, part.readings] = o.instrument.retract(read, noise).reshape(len(own), -1)
    return z


def _simulated(
    setting: Setting,
    cell: Cell,
    generators: tuple[np.random.Generator, ...],
    truth: Array,
    q: Array,
    refused: dict[int, str],
) -> Drawn:
    """Where postures touch, or instruments do not see everything: one trial after the other."""
    model = setting.true_model
    poses = np.array(np.broadcast_to(q, (len(truth), *q.shape[-2:])))
    z = np.full((len(truth), q.shape[-2], model.measurement.parts[-1].readings.stop), np.nan)
    for i, generator in enumerate(generators):
        if i in refused:
            continue
        try:
            data = simulate(model, model.parameters.mapping(truth[i]), poses[i], cell.noise, generator)
        except RefusedError as error:
            refused[i] = str(error)
            continue
        poses[i], z[i] = data.q, data.z
    return Drawn(generators, truth, poses, z, refused)
