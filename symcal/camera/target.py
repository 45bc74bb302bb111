"""What a camera looks at on the robot: a plate with equal discs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from symcal.errors import InputError

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """Equal discs on a plate, fixed to the robot's tool.

    Attributes:
        names: one per disc.
        points: disc centres in the target frame, shape (n, 3), mm.
        disc_radius: mm.
        normal: unit vector out of the discs' faces, in the target frame; they are seen from its side only.
        marked: the disc that carries a concentric hole of half its radius, to break the symmetry; None if alike.
        mount: nominal pose of the target on the robot's flange (last link frame), shape (4, 4), mm; None if not given.
    """

    names: tuple[str, ...]
    points: Float = field(compare=False)
    disc_radius: float
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    marked: str | None = None
    mount: Float | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if np.shape(self.points) != (len(self.names), 3) or not np.all(np.isfinite(self.points)):
            raise InputError(
                "one finite point of three coordinates for each name", key="points", found=np.shape(self.points)
            )
        if len(self.names) < 3 or len(set(self.names)) != len(self.names):
            raise InputError("at least three points with different names", key="points", found=", ".join(self.names))
        if not self.disc_radius > 0:
            raise InputError("must be positive", key="disc_radius", found=self.disc_radius)
        length = math.sqrt(sum(c * c for c in self.normal))
        if not length > 0:
            raise InputError("must not be zero", key="normal", found=self.normal)
        object.__setattr__(self, "normal", tuple(float(c) / length for c in self.normal))
        if self.marked is not None and self.marked not in self.names:
            raise InputError("no disc of this name", key="marked", found=self.marked, allowed=self.names)

    @property
    def by_name(self) -> dict[str, tuple[float, float, float]]:
        """The discs' centres by name, mm."""
        return {name: (float(x), float(y), float(z)) for name, (x, y, z) in zip(self.names, self.points, strict=True)}

    @staticmethod
    def triangle(side: float, disc_radius: float, marked: str | None = None, mount: Float | None = None) -> Target:
        """Three discs P1, P2, P3 at the corners of an equilateral triangle around the origin of the z = 0 plane; mm.

        P1 lies on +x, the others follow counter-clockwise about +z, out of the faces.
        """
        angles = np.deg2rad([0.0, 120.0, 240.0])
        corners = side / math.sqrt(3) * np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
        return Target(("P1", "P2", "P3"), corners, disc_radius, marked=marked, mount=mount)
