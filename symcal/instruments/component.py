"""Coordinates of a point along given directions: dial gauge, level, laser line.

h_k = d_k . p,        d_k unit vectors in the instrument's own frame

A zero that nobody knows is the instrument's unknown place along the direction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Self

import casadi as ca
import numpy as np
from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from symcal.instruments.protocol import Column, Edge, Instrument, Keys, Quantity, sigmas
from symcal.parameters import FRAME_AXES

SX = ca.SX


def _unit(vector: list[float]) -> list[float]:
    length = float(np.linalg.norm(vector))
    if not length > 0:
        raise PydanticCustomError("direction", "a direction cannot be the zero vector")
    return [value / length for value in vector]


Direction = Annotated[list[float], Field(min_length=3, max_length=3), AfterValidator(_unit)]


class ComponentKeys(Keys):
    """directions: by the names of their columns, in the instrument's frame; of any length but zero."""

    directions: Annotated[dict[str, Direction], Field(min_length=1, max_length=3)] = {"z": [0.0, 0.0, 1.0]}


@dataclass(frozen=True, slots=True)
class Component(Instrument):
    """Coordinates of points along directions.

    directions: unit vectors in the instrument's frame, by name.

    Example:
        >>> import symcal as sc
        >>> gauge = sc.Component({"z": (0.0, 0.0, 1.0)})
        >>> gauge.sees
        ('z', 'rx', 'ry')
    """

    name: ClassVar[str] = "component"
    label: ClassVar[str] = "coordinates"
    error_words: ClassVar[str] = "error along the directions"
    Config: ClassVar[type[Keys]] = ComponentKeys
    directions: Mapping[str, tuple[float, float, float]] = field(default_factory=lambda: {"z": (0.0, 0.0, 1.0)})

    @classmethod
    def configured(cls, keys: Any, _edge: Edge) -> Self:
        return cls({name: (v[0], v[1], v[2]) for name, v in keys.directions.items()})

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        return (Quantity("component", "mm", len(self.directions), 1e-9, sigmas(*self.directions), "sigma"),)

    @property
    def columns(self) -> tuple[Column, ...]:
        return tuple((name, "mm") for name in self.directions)

    @property
    def sees(self) -> tuple[str, ...]:
        """Of one direction along an axis neither shifts across it nor turns about it are seen."""
        used = np.abs(np.array(list(self.directions.values()))).max(axis=0) > 0
        still = int(np.flatnonzero(used)[0]) + 3 if used.sum() == 1 else -1
        return tuple(name for i, name in enumerate(FRAME_AXES) if (used[i] if i < 3 else i != still))

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        return SX(np.array(list(self.directions.values()))) @ point

    @classmethod
    def recalled(cls, settings: Mapping[str, Any], _file: Any) -> Self:
        return cls({name: tuple(v) for name, v in settings["directions"].items()})
