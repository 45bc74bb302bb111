"""The kinds of instrument by name: a kind is registered here and nowhere else."""

from __future__ import annotations

from symcal.camera.camera import Camera
from symcal.errors import InputError
from symcal.instruments.component import Component as Component
from symcal.instruments.constraint import FixedPoint as FixedPoint
from symcal.instruments.constraint import Plane as Plane
from symcal.instruments.direction import Direction as Direction
from symcal.instruments.distance import Distance as Distance
from symcal.instruments.pixels import Pixels as Pixels
from symcal.instruments.pose import Pose as Pose
from symcal.instruments.position import Position as Position
from symcal.instruments.protocol import Instrument

KINDS: dict[str, type[Instrument]] = {
    kind.name: kind for kind in (Position, Pose, Pixels, Distance, Component, Direction, FixedPoint, Plane)
}


Tracker = Position
"""A laser tracker, or whatever else gives positions."""


def register(kind: type[Instrument]) -> type[Instrument]:
    """Make a kind known by its name, in Python and in files; a decorator of its class.

    Raises:
        InputError: there is one of this name.

    Example:
        >>> import symcal as sc
        >>> @sc.register
        ... class Probe(sc.Position):
        ...     name = "probe"
        ...     label = "probed points"
        >>> Probe().columns
        (('x', 'mm'), ('y', 'mm'), ('z', 'mm'))
    """
    if kind.name in KINDS:
        raise InputError("there is a kind of this name", key="instrument", found=kind.name)
    KINDS[kind.name] = kind
    return kind


def kind_named(name: str) -> type[Instrument]:
    """The kind of this name.

    Raises:
        InputError: it is not registered.
    """
    if name not in KINDS:
        raise InputError("no such kind of instrument", key="instrument", found=name, allowed=KINDS)
    return KINDS[name]


def seen_by(camera: Camera, *, calibrate: bool) -> Instrument:
    """The instrument that a camera is.

    Args:
        calibrate: whether its intrinsics are to be found too.
    """
    return Pixels(camera, calibrate)
