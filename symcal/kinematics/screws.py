"""How frames move: the screws of coordinates, and frames with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from symcal.parameters import ParameterSet

SX = ca.SX


@dataclass(frozen=True, slots=True)
class Screw:
    """Velocity field of one coordinate: a turn about an axis through ``origin``, and a slide; in world, (3,).

    dp/ds = slide + turn x (p - origin) + sum_i c_i (dp/ds)_i = v + omega x p

    through: what the coordinate does through joint terms: slopes c_i and the screws of the joints.
    """

    turn: SX
    slide: SX
    origin: SX
    through: tuple[tuple[SX, Screw], ...] = ()

    @property
    def omega(self) -> SX:
        """Angular velocity; shape (3,)."""
        return sum((c * screw.omega for c, screw in self.through), self.turn)

    @property
    def v(self) -> SX:
        """Velocity of the tool-fixed point that is at the origin of world; shape (3,)."""
        return self.at(SX(3, 1))

    def at(self, point: SX) -> SX:
        """Velocity of a point fixed to the tool, in world; shape (3,)."""
        own = self.slide + ca.cross(self.turn, point - self.origin)
        return sum((c * screw.at(point) for c, screw in self.through), own)


@dataclass(frozen=True, slots=True)
class Station:
    """A frame in world that moves with the robot or stands still: rotation (3, 3), origin (3,), mm.

    screws: one per parameter: how the frame moves with it.
    """

    rotation: SX
    origin: SX
    screws: tuple[Screw, ...]


STILL = Screw(SX(3, 1), SX(3, 1), SX(3, 1))
"""Of what does not move."""


def screws_of(found: Mapping[str, Screw], parameters: ParameterSet) -> tuple[Screw, ...]:
    return tuple(found.get(name, STILL) for name in parameters.names)


def stack(screws: tuple[Screw, ...], point: SX) -> SX:
    """Velocities in world of a tool-fixed point for each screw; shape (3, len(screws)).

    All at once: every operation on SX costs as much as a hundred of its instructions.
    """
    if not screws:
        return SX(3, 0)
    turns, slides, origins = (ca.horzcat(*(getattr(s, name) for s in screws)) for name in ("turn", "slide", "origin"))
    own: SX = slides + ca.cross(turns, ca.repmat(point, 1, len(screws)) - origins, 1)
    if not any(screw.through for screw in screws):
        return own
    columns = zip(screws, ca.horzsplit(own), strict=True)
    return ca.horzcat(*(sum((c * other.at(point) for c, other in screw.through), at) for screw, at in columns))


def omegas(screws: tuple[Screw, ...]) -> SX:
    """Angular velocities in world for each screw; shape (3, len(screws))."""
    return ca.horzcat(*(screw.omega for screw in screws)) if screws else SX(3, 0)


def pose_of(station: Station) -> SX:
    """T_world_station, shape (4, 4)."""
    return ca.vertcat(ca.horzcat(station.rotation, station.origin), SX([[0, 0, 0, 1]]))
