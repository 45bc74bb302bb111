"""What a kind of instrument is: how a reading comes from where a target's feature stands in the instrument's own frame.

A feature is a point of the target with the target's axes, or the target's frame: (R, p), mm. A kind is one short file
that says what the instrument reads of it; everything else asks the kind what it can do, and never for its name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

SX = ca.SX
Array = NDArray[np.float64]
Unit = Literal["mm", "rad", "px"]
Draw = Callable[[tuple[int, ...]], Array]
"""Noise of one sigma in a shape."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """Residual components of one feature that share a noise sigma.

    noise: name of the sigma. size: how many components. floor: noise of data that have none (rounding), in the unit.
    alike: noise of this quantity that goes with 1 mm, 1 rad or 1 px of the first one of the kind, roughly.
    sigma_columns: names of their sigmas in tables. sigma_column: that of one sigma for all of them.
    """

    noise: str
    unit: Unit
    size: int
    floor: float
    sigma_columns: tuple[str, ...]
    sigma_column: str
    alike: float = 1.0


class Kind(Protocol):
    """A kind of instrument; stateless.

    name: as files call it. quantities: what the residual of one feature consists of.
    columns: names of the numbers of one reading in tables, with the unit of those that have one.
    reads_points: points of the target one by one, some of which may be missing; else its frame, whole.
    gives_point: a reading fixes the point; its residual is then an error of the tool in mm.
    error_words: what its error is, said to people: 'tool error' where a reading fixes the point, and else what it is.
    place: names of the increments of the instrument's own frame that it can tell; none if world is its frame.
    own: parameters of its own, such as a camera's numbers.
    """

    @property
    def name(self) -> str: ...
    @property
    def quantities(self) -> tuple[Quantity, ...]: ...
    @property
    def columns(self) -> tuple[tuple[str, Unit | None], ...]: ...
    @property
    def reads_points(self) -> bool: ...
    @property
    def gives_point(self) -> bool: ...
    @property
    def error_words(self) -> str: ...
    @property
    def place(self) -> tuple[str, ...]: ...
    @property
    def own(self) -> tuple[str, ...]: ...

    def predict(self, rotation: SX, point: SX, own: SX) -> SX:
        """The reading of a feature, shape (len(columns),)."""

    def residual(self, rotation: SX, point: SX, reading: SX, own: SX) -> SX:
        """Model minus measured, shape (sum of sizes,)."""

    def slopes(self, rotation: SX, point: SX, reading: SX | None, own: SX) -> tuple[SX, SX]:
        """Derivatives of the residual by the feature's twist (omega, v) in the instrument's frame, and by ``own``.

        Args:
            reading: None at a residual of zero: of a reading that is yet to be taken.
        """

    def error(self, rotation: SX, point: SX, reading: SX, own: SX, *, riding: bool) -> tuple[SX, SX]:
        """Error of the tool: position (3,) in the instrument's frame (riding: in world); attitude (3,) or (0,).

        Args:
            riding: the instrument is on the tool and the feature stands in world.
        """

    def retract(self, reading: Array, noise: Mapping[str, Draw]) -> Array:
        """Readings (N, k, len(columns)) with noise, by name of the sigma."""
