"""Noise of simulated readings: normal or uniform, by quantity, and by instrument where it differs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from symcal.instruments.protocol import Array, Draw


@dataclass(frozen=True, slots=True, init=False)
class Noise:
    """Independent noise per axis: standard deviation (normal) or half width (uniform), by quantity; mm, rad and px.

    by_instrument: for one observation by name, where it differs. The noise of a pose's orientation is a rotation vector
    applied on the right (in the frame that is measured).

    Example:
        >>> import symcal as sc
        >>> sc.Noise(position=0.05, distance=0.03).distribution
        'normal'
    """

    distribution: Literal["normal", "uniform"]
    sizes: Mapping[str, float]
    by_instrument: Mapping[str, Mapping[str, float]]

    def __init__(
        self,
        distribution: Literal["normal", "uniform"] = "normal",
        position: float = 0.0,
        orientation: float = 0.0,
        *,
        by_instrument: Mapping[str, Mapping[str, float]] | None = None,
        **sizes: float,
    ) -> None:
        object.__setattr__(self, "distribution", distribution)
        object.__setattr__(self, "sizes", {"position": position, "orientation": orientation, **sizes})
        object.__setattr__(self, "by_instrument", by_instrument or {})

    def sigma(self, size: float) -> float:
        """Standard deviation of this size."""
        return size / np.sqrt(3) if self.distribution == "uniform" else size

    def size(self, observation: str, quantity: str) -> float:
        """Of one quantity of an observation; 0 where nothing is said."""
        return self.by_instrument.get(observation, {}).get(quantity, self.sizes.get(quantity, 0.0))

    def draw(self, size: float, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
        if self.distribution == "uniform":
            return np.asarray(rng.uniform(-size, size, shape))
        return np.asarray(size * rng.normal(size=shape))

    def of(self, observation: str, quantities: Iterable[str], rng: np.random.Generator) -> dict[str, Draw]:
        """What draws the noise of each quantity of an observation."""
        return {name: partial(self._drawn, self.size(observation, name), rng) for name in quantities}

    def _drawn(self, size: float, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        return self.draw(size, shape, rng)
