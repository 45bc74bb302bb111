"""An instrument that is not there: a true robot, noise, slips, drop-outs, and a bump in the middle.

What it reads depends on the seed and the number of the request alone, so that it goes on alike after it was killed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symcal.calibration.simulate import simulate
from symcal.capture.aim import Aim
from symcal.config import conversion as config
from symcal.config.conversion import SimulatedData
from symcal.errors import InputError
from symcal.instruments.noise import Noise
from symcal.joints.backlash import direction_name
from symcal.model.model import Model
from symcal.words import is_term_number

Array = NDArray[np.float64]
Moves = Literal["target", "base"]

_SIGMA_LENGTH, _SIGMA_ANGLE = 1.0, np.deg2rad(0.3)  # mm and rad: errors of a robot, where the experiment says none
_AWAY, _TURNED = 1500.0, 1.0  # mm and rad: where the robot stands, as the instrument sees it
_NEAR = 10.0  # mm: a point that is unknown, about where it is guessed


@dataclass(frozen=True, slots=True)
class Mishaps:
    """What goes wrong. outliers, misses: shares of the readings; an outlier is off by `off` in a random direction.

    bump: number of the reading from which on something stands elsewhere, by `by` mm; None for never. moves: the target
    on the robot, or the robot's base (or the instrument: nothing tells one from the other).
    """

    outliers: float = 0.0
    misses: float = 0.0
    off: float = 5.0
    bump: int | None = None
    by: float = 1.0
    moves: Moves = "target"


@dataclass(frozen=True, slots=True)
class Simulated:
    """A true robot and what looks at it; made by `simulated`. truth: errors by name. noise: by group, mm and rad."""

    model: Model
    seed: int
    truth: Mapping[str, float]
    noise: Mapping[str, float]
    mishaps: Mishaps = field(default_factory=Mishaps)

    def read(self, number: int, q: Array, directions: Array) -> Array | None:
        """What is read at a posture (dof,), shape (w,); None where nothing is seen.

        Args:
            number: of the request. directions: from where joints come, shape (dof,).
        """
        rng, wrong = np.random.default_rng([self.seed, number]), self.mishaps
        if rng.uniform() < wrong.misses:
            return None
        slip = rng.uniform() < wrong.outliers
        truth = dict(self.truth)
        if wrong.bump is not None and number >= wrong.bump:
            shift = _direction(np.random.default_rng([self.seed, 0, 1]), 3) * wrong.by
            for name, value in zip(self._moved, shift, strict=True):
                truth[name] = truth.get(name, 0.0) + float(value)
        sizes = {
            g.observation: {h.quantity: self.noise[h.name] for h in self.model.measurement.groups}
            for g in self.model.measurement.groups
        }
        came = {direction_name(i): np.array([d]) for i, d in enumerate(directions, start=1)}
        z = simulate(self.model, truth, q[None], Noise(by_instrument=sizes), rng, conditions=came).z[0]
        if slip:
            own = min(3, len(z))
            z[:own] += _direction(rng, own) * wrong.off
        return None if np.isnan(z).all() else z

    @property
    def _moved(self) -> tuple[str, ...]:
        """Names of the coordinates that a bump changes."""
        names = self.model.parameters.names
        for stem in ("base",) if self.mishaps.moves == "base" else self._targets:
            found = tuple(f"{stem}_{axis}" for axis in "xyz")
            if set(found) <= set(names):
                return found
        raise InputError("nothing in this experiment that could be bumped is unknown", key="bump")

    @property
    def _targets(self) -> tuple[str, ...]:
        (o,) = self.model.task.observations
        return (*(o.target.qualified(point) for point in o.target.unknown_points), o.target.name, "tool")


def simulated(aim: Aim, seed: int, mishaps: Mishaps | None = None, noise: float | None = None) -> Simulated:
    """A robot with errors as the experiment says, or of 1 mm and 0.3 deg, that stands anywhere.

    Args:
        noise: times that of the plan.
    """
    experiment, model, rng = aim.experiment, aim.model, np.random.default_rng([seed, 0])
    source, units = experiment.file.data, dict(zip(model.parameters.names, model.parameters.units, strict=True))
    truth: dict[str, float] = {}
    if isinstance(source, SimulatedData):
        truth = config.truth_of(source, experiment.file, experiment.document, _kinematic(units, model), rng)
    if not truth:
        sizes = {"mm": _SIGMA_LENGTH, "rad": _SIGMA_ANGLE}
        truth = {name: float(rng.normal()) * sizes[unit] for name, unit in _kinematic(units, model).items()}
    for name in model.placement:
        far = {"mm": _AWAY, "rad": _TURNED} if name.startswith("base_") else {"mm": _NEAR, "rad": _NEAR / _AWAY}
        truth[name] = float(rng.uniform(-1, 1)) * far.get(units[name], 0.0)
    factor = 1.0 if noise is None else noise
    return Simulated(model, seed, truth, {k: v * factor for k, v in aim.nominal.items()}, mishaps or Mishaps())


def _kinematic(units: Mapping[str, str], model: Model) -> dict[str, str]:
    return {name: units[name] for name in model.kinematic if not is_term_number(name)}


def _direction(rng: np.random.Generator, size: int) -> Array:
    drawn = rng.normal(size=size)
    return np.asarray(drawn / np.linalg.norm(drawn))
